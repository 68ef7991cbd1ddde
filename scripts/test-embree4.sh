#!/bin/sh
# `make test`'s Embree 4 part: the native tests against Debian 13's Embree 4 in a prefix (see embree4-prefix.sh).
set -eu
cd "$(dirname "$0")/.."
if [ -e /usr/include/embree4/rtcore.h ]; then
    echo "test-embree4: Embree 4 is this system's own: the test suite has used it" >&2
    exit 0
fi
exports=$(scripts/embree4-prefix.sh target/embree4)
eval "$exports"
# Few and short tests: what counts is how long they take to build.
exec cargo test --config profile.dev.opt-level=1 --config 'profile.dev.package."*".opt-level=1' --test native

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
# What `unit` has built of dependencies is the same here; only what sees Embree is built anew, and with few and short tests
# what counts is how long that takes.
if [ -d target/debug/deps ] && [ ! -e "$CARGO_TARGET_DIR/debug" ]; then
    mkdir -p "$CARGO_TARGET_DIR/debug/deps"
    cp -a target/debug/.fingerprint target/debug/build "$CARGO_TARGET_DIR/debug/"
    find target/debug/deps -maxdepth 1 -type f \( -name '*.rlib' -o -name '*.rmeta' -o -name '*.so' -o -name '*.d' \) ! -name '*tyndall*' \
        -exec cp -a -t "$CARGO_TARGET_DIR/debug/deps" {} +
fi
exec cargo test --config profile.dev.opt-level=0 --test native

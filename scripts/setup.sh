#!/bin/sh
# Install what tyndall needs on Debian 12 or 13 and is not there yet; look at the Rust toolchain.
#
#   scripts/setup.sh            install (through sudo if not root)
#   scripts/setup.sh --check    only say what is missing; exit 1 if anything is
#
# Does nothing, in a few milliseconds, when nothing is missing.
set -eu

packages='build-essential pkg-config libembree-dev libopenvdb-dev libboost-dev libtbb-dev libclang-dev'
rust_wanted=1.85

# Debian packages rustfmt and clippy apart from its own Rust; `make test` wants them.
if [ "$(command -v cargo || true)" = /usr/bin/cargo ]; then
    packages="$packages rustfmt rust-clippy"
fi

say() { printf '%s\n' "setup: $*" >&2; }
status=0

command -v dpkg-query >/dev/null || {
    say "this is not Debian: install Embree (3.13 or 4.x), OpenVDB, TBB, boost's headers and libclang with headers by hand,"
    say "and name their prefixes with EMBREE_DIR and OPENVDB_DIR if they are not in /usr or /usr/local"
    exit 1
}

# One query for all: a package that dpkg has never heard of is reported on stderr and missing from the answer.
# shellcheck disable=SC2086
installed=$(dpkg-query -W -f '${binary:Package} ${db:Status-Status}\n' $packages 2>/dev/null | sed -n 's/^\([^: ]*\)[^ ]* installed$/\1/p')
missing=
for p in $packages; do
    case " $(echo $installed) " in
        *" $p "*) ;;
        *) missing="$missing $p" ;;
    esac
done

if [ -n "$missing" ]; then
    if [ "${1:-}" = --check ]; then
        say "missing:$missing"
        say "install them:  sudo apt-get install$missing"
        status=1
    else
        sudo=
        if [ "$(id -u)" -ne 0 ]; then
            command -v sudo >/dev/null || { say "not root and no sudo; as root:  apt-get install$missing"; exit 1; }
            sudo=sudo
        fi
        say "installing:$missing"
        # shellcheck disable=SC2086
        $sudo apt-get -q update && DEBIAN_FRONTEND=noninteractive $sudo apt-get -q install -y --no-install-recommends $missing
    fi
fi

# Rust: Debian 13's own will do, Debian 12's (1.63) will not.
help="get it from https://rustup.rs, or on Debian 13:  sudo apt-get install cargo rustc rustfmt rust-clippy"
if ! command -v cargo >/dev/null || ! command -v rustc >/dev/null; then
    say "no Rust toolchain; $rust_wanted or newer is needed: $help"
    status=1
else
    version=$(rustc --version 2>/dev/null | sed -n 's/^rustc \([0-9]*\.[0-9]*\).*/\1/p')
    major=${version%%.*}
    minor=${version#*.}
    if [ -z "$version" ]; then
        say "rustc does not tell its version (rustup without a toolchain?):  rustup default stable"
        status=1
    elif [ "$major" -lt "${rust_wanted%%.*}" ] || { [ "$major" -eq "${rust_wanted%%.*}" ] && [ "$minor" -lt "${rust_wanted#*.}" ]; }; then
        say "Rust $version is too old; $rust_wanted or newer is needed: $help, or:  rustup update stable"
        status=1
    fi
fi

[ $status -eq 0 ] && say "all there"
exit $status

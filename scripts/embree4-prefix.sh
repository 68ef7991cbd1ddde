#!/bin/sh
# Unpack Debian 13's Embree 4, and the C library it needs, into a prefix beside this system's own packages.
#
#   eval "$(scripts/embree4-prefix.sh)"          (prefix: target/embree4/prefix)
#   cargo test --test native
#
# Nothing is installed and no system file is touched: apt keeps its lists and its state in the prefix's own directory.
# Log on stderr; on stdout only the `export` lines. Does nothing but print when the prefix is complete.
set -eu

cd "$(dirname "$0")/.."
target=${1:-target/embree4}
mkdir -p "$target"
target=$(cd "$target" && pwd)
prefix=$target/prefix
state=$target/apt
suite=trixie
# The mirror that this system's own apt uses.
mirror=${DEBIAN_MIRROR:-$(apt-get indextargets --format '$(REPO_URI)' 'Created-By: Packages' 2>/dev/null | grep -v security | head -n 1)}
packages='libembree4-4 libembree-dev libtbb12 libtbbmalloc2 libtbbbind-2-5 libhwloc15 libudev1 libcap2 libc6 libstdc++6 libgcc-s1'

say() { printf '%s\n' "embree4-prefix: $*" >&2; }
die() { say "$*"; exit 1; }

[ -n "$mirror" ] || die "apt knows no mirror; set DEBIAN_MIRROR"
[ "$(dpkg --print-architecture 2>/dev/null)" = amd64 ] || die "this recipe is for Debian on amd64"

if [ ! -e "$prefix/.complete" ]; then
    for tool in apt-get dpkg-deb; do
        command -v $tool >/dev/null || die "$tool not found"
    done
    key=
    for k in /usr/share/keyrings/debian-archive-keyring.gpg /usr/share/keyrings/debian-archive-keyring.pgp; do
        [ -r $k ] && key=$k && break
    done
    [ -n "$key" ] || die "no Debian keyring: apt-get install debian-archive-keyring"

    # Give apt a world of its own: sources, lists, cache and an empty package state.
    rm -rf "$prefix"
    mkdir -p "$prefix" "$state/lists/partial" "$state/cache/archives/partial" "$state/etc/parts" "$state/debs"
    : >"$state/status"
    echo "deb [signed-by=$key] $mirror $suite main" >"$state/etc/sources.list"
    cat >"$state/etc/apt.conf" <<CONF
Dir::Etc "$state/etc";
Dir::Etc::sourcelist "$state/etc/sources.list";
Dir::Etc::sourceparts "$state/etc/parts";
Dir::Etc::parts "$state/etc/parts";
Dir::State "$state";
Dir::State::lists "$state/lists";
Dir::State::status "$state/status";
Dir::Cache "$state/cache";
APT::Architecture "amd64";
APT::Architectures { "amd64"; };
APT::Sandbox::User "";
APT::Install-Recommends "false";
Acquire::Languages "none";
Acquire::Retries "3";
CONF
    # Keep the system's proxy and mirror settings, if it has any.
    apt-config dump 2>/dev/null | grep -E '^Acquire::(http|https)::' >>"$state/etc/apt.conf" || true

    say "reading Debian $suite's package list"
    APT_CONFIG="$state/etc/apt.conf" apt-get -qq update >&2
    say "downloading: $packages"
    # shellcheck disable=SC2086
    (cd "$state/debs" && APT_CONFIG="$state/etc/apt.conf" apt-get -qq download $packages >&2)
    for deb in "$state"/debs/*.deb; do
        dpkg-deb -x "$deb" "$prefix"
    done
    rm -rf "$state"
    : >"$prefix/.complete"
fi

# Debian 13's libc6 keeps everything below /usr; look in both places all the same.
loader=
for l in "$prefix/usr/lib64/ld-linux-x86-64.so.2" "$prefix/lib64/ld-linux-x86-64.so.2"; do
    [ -e "$l" ] && loader=$l && break
done
[ -n "$loader" ] || die "no ld-linux-x86-64.so.2 in $prefix: remove the prefix and run again"
[ -e "$prefix/usr/include/embree4/rtcore.h" ] || die "no embree4/rtcore.h in $prefix: remove the prefix and run again"

# The prefix first (its libc must match its loader), then this system's directories (OpenVDB).
triplet=x86_64-linux-gnu
path=$prefix/usr/lib/$triplet:$prefix/lib/$triplet:/usr/lib/$triplet:/lib/$triplet:/usr/local/lib
say "$(du -sh "$prefix" | cut -f1) in $prefix"
cat <<VARS
export EMBREE_DIR='$prefix/usr'
export EMBREE_MAJOR=4
export CARGO_TARGET_DIR='$target'
export CARGO_TARGET_X86_64_UNKNOWN_LINUX_GNU_RUNNER='$loader --library-path $path'
VARS

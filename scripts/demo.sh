#!/bin/sh
# `make demo`: a picture out of a VDB file and a derivative of it; the paths are printed at the end.
set -eu
cd "$(dirname "$0")/.."
cargo build --release
mkdir -p out
tyndall="${CARGO_TARGET_DIR:-target}"/release/tyndall
"$tyndall" render scenes/fire/scene.xml --spp 64 -o out/fire.exr --preview out/fire.png --overwrite
"$tyndall" grad scenes/fire/scene.xml --wrt density_scale --spp 128 -o out/fire_derivative.exr --preview out/fire_derivative.png --overwrite
printf '\nWritten:\n'
ls -1 out/fire.exr out/fire.json out/fire.png out/fire_derivative.exr out/fire_derivative.json out/fire_derivative.png

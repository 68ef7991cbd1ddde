#!/bin/sh
# `make figures [TIME=150]`: the figures of the theory's supplement into out/figures/; their paths are printed at the end.
# Figure 1: picture, derivative, finite differences and z scores of the three examples. Figure 2: fits of the same.
# The first argument is the time in seconds of a check, and of a run of a fit, at most: there are 3 checks and 8 runs. Then come targets and pictures, 3 minutes or so.
set -eu
cd "$(dirname "$0")/.."
time="${1:-150}"
case "$time" in
'' | *[!0-9]* | 0*)
    echo "error: \`$time\` is not a time
  help: give whole seconds, for example \`make figures TIME=60\`" >&2
    exit 2
    ;;
esac
cargo build --release --bins --example montage
target="${CARGO_TARGET_DIR:-target}"/release
out=out/figures
mkdir -p "$out"

# An open end (3: undecided, not converged) is an answer, which the figure shows.
answer() {
    "$target"/tyndall "$@" --overwrite || [ $? -eq 3 ]
}

# Figure 1, a row an example: scene and parameter.
check() {
    answer check "scenes/$1/scene.xml" --wrt "$2" --max-time "${time}s" --at value --sheet "$out/$1_check.png" -o "$out/$1_check.json"
}
check point_light light_x
check sphere sphere_x
check dielectric ior
"$target"/examples/montage "$out/figure_1.png" \
    "Point light, by its x=$out/point_light_check.png" \
    "Ball in fog, by its x=$out/sphere_check.png" \
    "Glass around smoke, by its index=$out/dielectric_check.png"

# Figure 2, a sheet an example: loss and parameters of all runs, and the pictures of the first.
fit() {
    answer fit "scenes/$1/fit.toml" --seeds 1 --max-time "${time}s" -o "$out/$1"
}
fit point_light
fit sphere
fit dielectric
plots() {
    echo "$out/$1/$2.png,$out/$1/$3.png"
}
sheet() {
    name=$1 title=$2
    shift 2
    "$target"/examples/montage "$out/figure_2_$name.png" "$title=$(plots "$name" loss "$1")" \
        ${3:+"=$(plots "$name" "$2" "$3")"} "First run: start, middle, end, target=$out/$name/stills_1.png"
}
sheet point_light "A light from its shadow in fog" light_x light_y light_z
sheet sphere "A ball in fog from one view" sphere_x sphere_y sphere_z
sheet dielectric "An index of refraction from a beam in smoke" ior

printf '\nWritten:\n'
ls -1 "$out"/figure_*.png "$out"/*/animation_*.png

# The commands of the README. Each installs what it needs (scripts/setup.sh), then builds and runs.

.PHONY: all setup build demo figures test lint unit embree4 docs stress msrv bench bench-peer install clean

# A build from nothing is quicker, and its code faster, without what later builds and debuggers could use.
ifdef CI
export CARGO_INCREMENTAL := 0
export CARGO_PROFILE_DEV_DEBUG := 0
endif

all: build

setup:
	@scripts/setup.sh

build: setup
	cargo build --release

# Pictures of a VDB scene and of a derivative: EXR, report and PNG in out/.
demo: setup
	@scripts/demo.sh

# Figures 1 and 2 of the theory's supplement, in out/figures/; TIME: seconds of each of 3 checks and 8 runs of fits, at most.
figures: setup
	@scripts/figures.sh $(TIME)

# The gate: everything that has to hold on every commit.
test: setup lint unit docs embree4

lint:
	cargo fmt --all --check
	cargo clippy --workspace --all-targets -- -D warnings

unit:
	cargo test --workspace

docs:
	RUSTDOCFLAGS="-D warnings" cargo doc --workspace --no-deps

# The native wrappers against Embree 4 (Debian 13's), in a target folder of its own; where Embree 4 is installed already,
# `unit` has tested it.
embree4:
	@scripts/test-embree4.sh

# Slow suites.
stress: build
	status=0; target/release/tyndall stress --suite core || status=$$?; \
	cargo test --release --test suite -- --ignored --nocapture --skip stress:: || status=$$?; exit $$status

# The least Rust that is promised, in a folder of its own.
msrv: setup
	rustup toolchain install 1.85 --profile minimal
	CARGO_TARGET_DIR=target/msrv cargo +1.85 check --workspace --all-targets

bench: build
	cargo bench --bench grid
	benches/run.sh

# Beside Mitsuba, with a Python that has it: make bench-peer PEER=venv/bin/python (benches/peer/README.md).
PEER ?= python3
bench-peer: build
	$(PEER) benches/peer/efficiency.py fog fire room glass glass-independent
	$(PEER) benches/peer/cloud.py
	$(PEER) benches/peer/cloud.py --spp 64

install: setup
	cargo install --path . --locked

clean:
	cargo clean

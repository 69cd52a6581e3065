# make demo   a bundled character, baked, fitted, measured: ends with demo/run/report.html
# make serve  the service, on this machine only: http://127.0.0.1:7878
# make test   format, lints, documentation, every test
# make bench  the measured tables of README
# make soak   a studio's day against the service: kills, cancels, and the same bytes at its end
# make grpc   the code of proto/poselight.proto
# make fuzz   the readers of foreign bytes, ten million runs each, and the service by its document
# Every target brings what it needs; a second run is quick.

CARGO ?= cargo
VENV := .venv
BIN = $(or $(CARGO_TARGET_DIR),target)/release/poselight
FUZZ_RUNS ?= 10000000
# Where the demo goes and what it adds; a test runs it small with a binary that is already built.
DEMO ?= demo
DEMO_FLAGS ?= --rays 128 --reference-poses 30 --family occluder --include-rest
BUILT ?= build

.PHONY: demo serve test bench soak fuzz grpc openapi setup build

setup:
	@.ci/setup

build: setup
	$(CARGO) build --release --locked

demo: $(BUILT)
	$(BIN) sample figure -o $(DEMO)/figure.glb
	$(BIN) run $(DEMO)/figure.glb -o $(DEMO)/run --hold-out jump $(DEMO_FLAGS)
	@echo "Look at $(DEMO)/run/report.html"

serve: $(BUILT)
	$(BIN) serve $(SERVE_FLAGS)

# The tables of README. CHARACTERS names a folder of GLB files; without it the table of characters
# is made from the bundled one.
CHARACTERS ?= $(DEMO)
ASSET_FLAGS ?= --rays 64
# The scene whose clips are left out in turn, and with what.
SCENE ?= $(DEMO)/figure.glb
GENERALISE_FLAGS ?= --fps 4 --rays 64 --reference-rays 256 --family linear,pca-linear,occluder
# OBJ files that other tracers, as far as they are installed, are compared on.
MESHES ?=
bench: setup
	$(CARGO) bench --locked --bench trace
	$(CARGO) bench --locked --bench transport
	$(CARGO) bench --locked --bench evaluate
	$(CARGO) bench --locked --bench fit
	$(CARGO) bench --locked --bench light
	$(CARGO) bench --locked --bench subdivide
	$(CARGO) bench --locked --bench serve
	$(CARGO) bench --locked --bench stability
	$(CARGO) run --release --locked -- sample figure -o $(DEMO)/figure.glb
	$(CARGO) bench --locked --bench choice -- $(DEMO)/figure.glb
	$(CARGO) bench --locked --bench generalise -- $(SCENE) $(GENERALISE_FLAGS)
	$(CARGO) bench --locked --bench poses
	$(CARGO) bench --locked --bench papers
	$(CARGO) bench --locked --bench assets -- $(CHARACTERS) $(ASSET_FLAGS)
	python3 benches/large.py $(BIN)
	python3 benches/instances.py $(BIN)
	@benches/peers/validate $(BIN) $(DEMO)/figure.glb walk
	@for mesh in $(MESHES); do python3 benches/peers/occlusion.py $$mesh $(BIN); done

# POSELIGHT_ASSETS names a folder of scenes; without it the day is the bundled character's.
soak: setup
	$(CARGO) test --release --locked --test serve -- --ignored a_long_day

# The readers of foreign bytes, FUZZ_RUNS runs each. libFuzzer is compiled from C++.
fuzz: setup
	@.ci/setup fuzz
	@for target in importer blob recipe dataset; do tests/fuzz/run $$target -runs=$(FUZZ_RUNS) || exit 1; done
	$(MAKE) build openapi OPENAPI_BIN=$(BIN) EXAMPLES=600

# The service driven from its own OpenAPI document.
OPENAPI_BIN ?= $(or $(CARGO_TARGET_DIR),target)/debug/poselight
EXAMPLES ?= 20
openapi: $(VENV)-openapi/ready
	$(VENV)-openapi/bin/python tests/openapi/fuzz.py $(OPENAPI_BIN) $(EXAMPLES)

$(VENV)-openapi/ready: tests/openapi/requirements.txt
	@.ci/venv $(VENV)-openapi tests/openapi/requirements.txt

# Without protoc. What it writes is kept; make test holds it against the interface.
grpc:
	$(CARGO) run --locked --quiet --manifest-path tests/generate/Cargo.toml

test: setup $(VENV)/ready
	@.ci/setup test
	$(CARGO) fmt --check
	$(CARGO) update --workspace --locked --quiet --manifest-path tests/fuzz/Cargo.toml
	$(CARGO) clippy --locked --all-targets -- -D warnings
	$(CARGO) clippy --locked --lib --no-default-features --features runtime -- -D warnings
	$(CARGO) run --locked --quiet --manifest-path tests/generate/Cargo.toml -- --check
	RUSTDOCFLAGS="-D warnings" $(CARGO) doc --locked --no-deps
	POSELIGHT_PYTHON="$(CURDIR)/$(VENV)/bin/python" $(CARGO) test --locked
	$(MAKE) openapi

# zarr-python and numpy read the data sets that the tests write.
$(VENV)/ready: tests/requirements.txt
	@.ci/venv $(VENV) tests/requirements.txt

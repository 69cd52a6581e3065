# Builds on the official Rust image for Debian 13, whose own Embree is version 4, and runs on slim
# Debian 13 as a user without rights; to write into your folder it must run as you:
#   docker build -t poselight .
#   docker run --rm --user "$(id -u):$(id -g)" -v "$PWD:/work" poselight run hero.glb -o hero
# As a service it writes into one volume and nowhere else; other machines need a token:
#   docker run --rm -v poselight:/data poselight token --data /data create studio
#   docker run --rm --read-only -v poselight:/data -p 7878:7878 poselight serve --data /data --listen 0.0.0.0:7878
FROM rust:1-trixie AS build
RUN apt-get update && apt-get install -y --no-install-recommends libclang-dev libembree-dev && rm -rf /var/lib/apt/lists/*
WORKDIR /build
COPY . .
RUN cargo build --release --locked

FROM debian:trixie-slim
RUN apt-get update && apt-get install -y --no-install-recommends libembree4-4 && rm -rf /var/lib/apt/lists/* \
    && useradd --create-home --uid 10001 poselight && mkdir /work /data && chown poselight /work /data
COPY --from=build /build/target/release/poselight /usr/local/bin/poselight
USER poselight
WORKDIR /work
ENTRYPOINT ["poselight"]

# Sourced by the scripts beside it: what installs packages, or says which are missing.

say() { echo "setup: $*" >&2; }

# usage: apt PACKAGE...
apt() {
    run=""
    if [ "$(id -u)" != 0 ]; then
        command -v sudo >/dev/null || { say "please install as root: apt-get install $*"; exit 1; }
        run=sudo
    fi
    say "installing $*"
    [ -n "${apt_updated:-}" ] || { $run apt-get update -qq; apt_updated=1; }
    DEBIAN_FRONTEND=noninteractive $run apt-get install -y -qq --no-install-recommends "$@" >/dev/null
}

# Sourced by the scripts beside it: words, and packages of the system.

say() { printf '%s: %s\n' "$(basename "$0" .sh)" "$*" >&2; }
fail() { say "$*"; exit 1; }

install_system_packages() {
    local as_root=() install=(apt-get --quiet install --yes --no-install-recommends "$@")
    if ! command -v apt-get >/dev/null; then
        fail "system packages are missing; install what Debian calls: $*"
    fi
    if [ "$(id -u)" != 0 ]; then
        sudo -n true 2>/dev/null || fail "system packages are missing; please run: sudo apt-get install $*"
        as_root=(sudo -n)
    fi
    say "installing the system packages $*"
    # A new machine has no package lists. That another source of the user's can't be read (update's failure) does no harm.
    "${as_root[@]}" apt-get --quiet update >&2 || true
    "${as_root[@]}" "${install[@]}" </dev/null >&2 || fail "apt-get failed (above); please install: $*"
}

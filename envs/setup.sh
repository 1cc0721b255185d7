#!/bin/sh
# Makes or completes .venv: a suitable Python, the system's libraries, the pinned packages, those of src/.
#   envs/setup.sh [test] [learned]     PYTHON=... names the interpreter; exit status 2: something to do first
# What is done is stamped inside .venv with the hash of what it was done from; a second run does nothing.
set -eu
cd "$(dirname "$0")/.."
root=$(pwd -P)
PATH=$(printf %s "$PATH" | tr : '\n' | grep -vxF "$root/.venv/bin" | paste -sd: -)

say() { printf 'setup: %s\n' "$*" >&2; }
stop() { say "$*"; exit 2; }

# ---- packages of the system

is_root() { [ "$(id -u)" = 0 ]; }
may_install() { is_root || { command -v sudo >/dev/null && sudo -n true 2>/dev/null; }; }
as_root() { if is_root; then "$@"; else sudo -n "$@"; fi; }
apt() { as_root env DEBIAN_FRONTEND=noninteractive apt-get "$@"; }

apt_install() {
    say "installing $* with apt-get"
    apt-cache show "$@" >/dev/null 2>&1 || apt update || return
    apt install --yes --no-install-recommends "$@" && return
    apt update && apt install --yes --no-install-recommends "$@"   # the lists were out of date
}

need_packages() { # why, Debian's names of what is missing
    why=$1; shift
    may_install || stop "$why; run this, then repeat: sudo apt-get install --yes $*"
    apt_install "$@" >&2 || stop "$why, and apt-get could not install: $*"
}

# ---- the interpreter

is_suitable() { "$1" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 15))' 2>/dev/null; }
has_ensurepip() { "$1" -c 'import ensurepip, venv' 2>/dev/null; }
has_pip() { "$1" -c 'import pip, venv; raise SystemExit([*map(int, pip.__version__.split(".")[:2])] < [22, 3])' 2>/dev/null; }

first_python() { # check: prints the first interpreter that is suitable and passes the check
    # 3.14 comes late because one pinned package has no wheel for it and must be compiled.
    for candidate in ${PYTHON:-python3.13 python3.12 python3.11 python3.14 python3 python}; do
        if is_suitable "$candidate" && "$1" "$candidate"; then echo "$candidate"; return; fi
    done
    return 1
}
find_python() { python=$(first_python has_ensurepip || first_python has_pip); }

missing_python_packages() {
    if bare=$(first_python true); then
        "$bare" -c 'import sys; print("python{}.{}-venv".format(*sys.version_info))'
    elif grep -qs '^VERSION_CODENAME=jammy' /etc/os-release; then
        echo python3.11 python3.11-venv   # its python3 is 3.10
    else
        echo python3 python3-venv
    fi
}

choose_python() {
    find_python && return
    [ -z "${PYTHON:-}" ] || is_suitable "$PYTHON" || stop "PYTHON=$PYTHON is not a Python 3.11 to 3.14 that runs"
    why="puckbench needs Python 3.11 to 3.14 with venv and pip, and none was found"
    command -v apt-get >/dev/null || stop "$why (PYTHON=... names one outside PATH)"
    # shellcheck disable=SC2046  # one word per package
    need_packages "$why" $(missing_python_packages)
    find_python || stop "$why even now (PYTHON=... names one outside PATH)"
}

# ---- the libraries of the system that wheels load

require_libraries() {
    missing=$("$python" envs/system_packages.py)
    [ -n "$missing" ] || return 0
    why="Open3D needs system libraries that are not here"
    command -v apt-get >/dev/null || stop "$why: $("$python" envs/system_packages.py --libraries)"
    # shellcheck disable=SC2086  # one word per package
    need_packages "$why" $missing
    missing=$("$python" envs/system_packages.py --libraries)
    [ -z "$missing" ] || stop "$why even now: $missing"
}

# ---- the browser in which a test opens the report

has_browser() {
    for candidate in ${CHROMIUM:-chromium chromium-browser google-chrome google-chrome-stable chrome}; do
        ! command -v "$candidate" >/dev/null || return 0
    done
    return 1
}
require_browser() {
    ! has_browser || return 0
    why="the test of the report needs Chromium or Chrome (CHROMIUM=... names one outside PATH)"
    command -v apt-get >/dev/null || stop "$why"
    need_packages "$why" chromium
    has_browser || stop "$why even now"
}

# ---- the program with which a test's store copies files

require_rsync() {
    ! command -v rsync >/dev/null || return 0
    why="the test of a store needs rsync"
    command -v apt-get >/dev/null || stop "$why"
    need_packages "$why" rsync
}

# ---- the virtual environment

version() { "$1" -c 'import sys; print(sys.version_info[:2])' 2>/dev/null; }
is_wanted() { [ -z "${PYTHON:-}" ] || [ "$(version "$PYTHON")" = "$(version .venv/bin/python)" ]; }
is_whole() {
    # .home is written last and holds the place, since a moved environment's commands point to the old one;
    # .installing is left behind by an installation that was cut short.
    [ "$(cat .venv/.home 2>/dev/null)" = "$root" ] && [ ! -e .venv/.installing ] &&
        is_suitable .venv/bin/python && has_pip .venv/bin/python
}

make_venv() {
    [ ! -e .venv ] || say "making .venv anew: it is incomplete, was moved, or has another Python"
    rm -rf .venv
    if has_ensurepip "$python"; then
        "$python" -m venv "$root/.venv"
    else
        "$python" -m venv --without-pip "$root/.venv"
        "$python" -m pip --python "$root/.venv/bin/python" install --quiet pip
    fi
    printf '%s\n' "$root" >.venv/.home
}

pip_install() { # --no-build-isolation: what has no wheel is built with the pinned setuptools too
    PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_USE_PEP517=1 \
        .venv/bin/python -m pip install --no-build-isolation "$@" >.venv/.pip.log 2>&1 && return
    grep '^ERROR' .venv/.pip.log >&2 || tail -n 20 .venv/.pip.log >&2
    return 1
}

tell() { # packages: how far pip is, while it runs
    while sleep 15 >/dev/null 2>&1 && kill -0 $$ 2>/dev/null; do # until this script ends or is killed
        if grep -q '^Installing collected' .venv/.pip.log; then say "unpacking"; continue; fi
        say "$(grep -cE '^(Collecting|Requirement already)' .venv/.pip.log) of about $1 packages are here"
    done
}

hash_of() {
    .venv/bin/python -c 'import hashlib, pathlib, sys
print(hashlib.sha256(b"".join(pathlib.Path(name).read_bytes() for name in sys.argv[1:])).hexdigest())' "$@"
}
is_done() { [ "$(cat ".venv/.done-$1" 2>/dev/null)" = "$2" ]; }
mark_done() { printf '%s\n' "$2" >".venv/.done-$1.new" && mv ".venv/.done-$1.new" ".venv/.done-$1"; }

install_locks() { # names: the packages of envs/<name>.lock, all in one go
    key=$(hash_of envs/*.lock envs/cuda.constraints)
    new=
    for name in "$@"; do is_done "$name" "$key" || new="$new $name"; done
    [ -n "$new" ] || return 0
    say "installing the pinned packages of$new into .venv (1.5 GB at first, torch more; takes minutes)"
    : >.venv/.installing
    pip_install "$(grep '^setuptools==' envs/requirements.lock)"
    # shellcheck disable=SC2046  # one word per lock
    tell "$(cat $(printf 'envs/%s.lock ' "$@") | grep -c '^[A-Za-z]')" &
    teller=$!
    trap 'kill "$teller" 2>/dev/null || :' EXIT
    # shellcheck disable=SC2046  # two words per lock
    pip_install $(printf -- '--requirement envs/%s.lock ' "$@")
    rm .venv/.installing
    for name in "$@"; do mark_done "$name" "$key"; done
}

install_ours() {
    key=$(hash_of src/*/pyproject.toml)
    ! is_done ours "$key" || return 0
    # shellcheck disable=SC2046  # two words per package
    pip_install --no-deps $(for file in src/*/pyproject.toml; do echo "--editable ./${file%/*}"; done)
    mark_done ours "$key"
}

for group in "$@"; do
    [ -f "envs/$group.lock" ] || stop "there is no envs/$group.lock"
done
if is_whole && is_wanted; then python=.venv/bin/python; else choose_python; fi
require_libraries
case " $* " in *" test "*) require_browser; require_rsync ;; esac
[ "$python" = .venv/bin/python ] || make_venv
install_locks requirements "$@"
install_ours

# Sourced by the other scripts: makes .venv when it is missing and installs softfuse into it when it is not there
# or pyproject.toml has changed. Usage: prepare_environment [EXTRA]; afterwards .venv/bin/python is ready.

find_python() {
    local candidate
    for candidate in ${PYTHON:+"$PYTHON"} python3 python3.14 python3.13 python3.12 python3.11 python; do
        if "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1; then
            echo "$candidate"
            return
        fi
    done
    echo "error: softfuse needs Python 3.11 or newer; install it, or name it: PYTHON=/path/to/python $0" >&2
    return 1
}

prepare_environment() {
    local extra="${1:-}" python installed
    installed=".venv/softfuse-${extra:-base}.toml"
    if ! .venv/bin/python -m pip --version >/dev/null 2>&1; then
        python="$(find_python)" || return 1
        echo "Making .venv with $("$python" --version)"
        if ! "$python" -m venv --clear .venv; then
            echo "error: '$python -m venv' failed; on Debian and Ubuntu: apt install python3-venv" >&2
            return 1
        fi
    fi
    # The copy of pyproject.toml tells what is installed; it is written last, so that a broken install is repeated.
    if ! cmp -s pyproject.toml "$installed"; then
        echo "Installing softfuse and its dependencies into .venv (a few minutes the first time)"
        .venv/bin/python -m pip install --quiet --no-input --disable-pip-version-check \
            --editable ".${extra:+[$extra]}" </dev/null || return 1
        cp pyproject.toml "$installed"
    fi
}

# A test looks at the live view in a browser, driven by chromedriver.
prepare_browser() {
    if command -v chromium >/dev/null && command -v chromedriver >/dev/null; then
        return
    fi
    if command -v apt-get >/dev/null && [ "$(id -u)" = 0 ]; then
        echo "Installing chromium and chromedriver"
        { apt-get update -qq && apt-get install -y -qq chromium chromium-driver; } >/dev/null </dev/null && return
    fi
    echo "error: the tests need chromium and chromedriver; on Debian: sudo apt install chromium chromium-driver" >&2
    return 1
}

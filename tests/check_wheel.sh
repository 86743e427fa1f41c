#!/usr/bin/env bash
# Builds source distribution and wheel into dist/, and tries the wheel in an environment and a folder of its own: what
# is left out of it, or needs more than the dependencies of pyproject.toml, is missed there. `make wheel-check` runs it.
set -euo pipefail
python="${1:-python3}"
sources="$(cd "$(dirname "$0")/.." && pwd)"
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
install() {
    # Modules are compiled when they are imported, which most never are.
    "$work/$1/bin/python" -m pip install --quiet --disable-pip-version-check --no-compile "${@:2}"
}

cd "$sources"
rm -rf dist
"$python" -m venv "$work/tools"
install tools build twine
# The wheel is built from the source distribution, so that this one is complete.
"$work/tools/bin/python" -m build --outdir dist . > "$work/log" 2>&1 || { cat "$work/log"; exit 1; }
"$work/tools/bin/python" -m twine check --strict dist/*

"$python" -m venv "$work/user"
install user -c constraints.txt dist/*.whl
cp tests/import_all.py "$work"
cd "$work"
user/bin/python import_all.py
user/bin/flgpr demo -o demo-result
test -s demo-result/report.html

#!/usr/bin/env bash
# Bundle the page into the package, or with --check tell whether the bundle there is the one of these sources.
set -euo pipefail
cd "$(dirname "$0")"
home=../src/flgpr/viewer/static
out="$home"
if [ "${1:-}" = "--check" ]; then
    out="$(mktemp -d)"
    trap 'rm -rf "$out"' EXIT
fi
[ -d node_modules ] || npm ci --silent
PATH="$PWD/node_modules/.bin:$PATH"
tsc --noEmit --incremental --tsBuildInfoFile node_modules/.cache/tsc.json
notice="/*! With uPlot: $(cat node_modules/uplot/LICENSE) */"
esbuild src/main.ts --bundle --minify --format=iife --target=es2022 --charset=utf8 --legal-comments=inline \
    --log-level=warning --banner:js="$notice" --outfile="$out/app.js"
esbuild src/app.css --bundle --minify --charset=utf8 --log-level=warning --banner:css="$notice" --outfile="$out/app.css"
cp src/index.html src/icon.svg "$out/"
if [ "$out" != "$home" ]; then
    for file in app.js app.css index.html icon.svg; do
        cmp "$out/$file" "$home/$file" || { echo "viewer/build.sh has not been run since the sources changed"; exit 1; }
    done
fi

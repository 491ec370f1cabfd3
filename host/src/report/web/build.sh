#!/bin/sh
# Bundles the page's script, three.js included, into dist/report.js, what `weldpath open` adds to it, fflate included, into dist/editor.js, and
# that of its start page into dist/start.js.
# Needs node and npm, and the network once; cargo needs none of them, for the bundles are committed. Run it after a change in
# src/ or editor/src/ or of a version in package.json.
set -eu
cd "$(dirname "$0")"
npm ci --silent --no-audit --no-fund
# A test compares these sums with those of the sources, so that no bundle can fall behind them.
bundle() {
    npx esbuild "$1" --bundle --minify --format="$2" --target=es2022 --legal-comments=inline \
        --banner:js="/* weldpath $3, sources $4 */" --outfile="dist/$3.js"
}
bundle src/main.js iife report "$(cat src/*.js package-lock.json | cksum | tr ' ' '-')"
editor=$(cat editor/src/*.js src/dom.js src/texts.js package-lock.json | cksum | tr ' ' '-')
bundle editor/src/main.js iife editor "$editor"
bundle editor/src/start.js iife start "$editor"
cp node_modules/three/LICENSE dist/LICENSE-three.txt
cp node_modules/fflate/LICENSE dist/LICENSE-fflate.txt

#!/bin/sh
# Bundles the page's script, three.js included, into dist/report.js. Needs node and npm, and the network once; cargo needs
# none of them, for the bundle is committed. Run it after a change in src/ or of a version in package.json.
set -eu
cd "$(dirname "$0")"
npm ci --silent --no-audit --no-fund
# A test compares this sum with that of the sources, so that the bundle cannot fall behind them.
sum=$(cat src/*.js package-lock.json | cksum | tr ' ' '-')
npx esbuild src/main.js --bundle --minify --format=iife --target=es2022 --legal-comments=inline \
    --banner:js="/* weldpath report, sources $sum */" --outfile=dist/report.js
cp node_modules/three/LICENSE dist/LICENSE-three.txt

#!/bin/sh
# The package for Python: its wheel as README.md installs it, its types, its tests, in an environment of its own under target/.
# Ends with 77 where there is no Python 3.10 with venv and pip, or no package index.
set -eu
cd "$(dirname "$0")/.."
environment=target/python
python3 -c 'import sys; sys.exit(sys.version_info < (3, 10))' && python3 -m venv $environment &&
    $environment/bin/pip install --quiet 'maturin>=1.9,<2' || exit 77
grep -q '^    pip install ./python$' README.md docs/python.md
# No build in isolation: the maturin that is there, and the artifacts of the workspace.
PATH="$PWD/$environment/bin:$PATH" $environment/bin/pip install --quiet --no-build-isolation './python[test]'
(cd python && ../$environment/bin/mypy)
$environment/bin/pytest --quiet -p no:cacheprovider python/tests

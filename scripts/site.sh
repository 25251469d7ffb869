#!/usr/bin/env bash
# Builds the documentation into build/site/VERSION; build/site/index.html leads to it and lists the
# versions that are there. Sphinx has an environment of its own, .venv-site. A warning (a dead link,
# a page that is in no list) ends the build.

set -euo pipefail

readonly ROOT="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd -P)"
readonly SITE="$ROOT/build/site" SOURCE="$ROOT/build/site-source" VENV="$ROOT/.venv-site"
cd "$ROOT"

if ! cmp -s requirements-site.txt "$VENV/requirements-site.txt"; then
  echo "set-up: Sphinx into .venv-site"
  .venv/bin/python -m venv --clear "$VENV"
  "$VENV/bin/python" -m pip install --quiet --disable-pip-version-check --require-hashes \
    -r requirements-site.txt
  cp requirements-site.txt "$VENV/"
fi

version="$(.venv/bin/tombo --version)"
export TOMBO_VERSION="${version#tombo }"
.venv/bin/python -m tombo_benchmarks.docs.site_source "$SOURCE"
"$VENV/bin/python" -m sphinx --quiet --fail-on-warning --keep-going -c scripts/site \
  -d build/site-doctrees "$SOURCE" "$SITE/$TOMBO_VERSION"

{
  echo '<!doctype html><meta charset="utf-8"><title>Tombo</title>'
  echo "<meta http-equiv=\"refresh\" content=\"0; url=$TOMBO_VERSION/index.html\"><ul>"
  for folder in "$SITE"/*/; do
    name="$(basename "$folder")"
    echo "<li><a href=\"$name/index.html\">Tombo $name</a></li>"
  done
  echo '</ul>'
} >"$SITE/index.html"
echo "site: build/site/index.html"

#!/usr/bin/env bash
# Pins in constraints.txt the newest versions that pyproject.toml allows. torch alone keeps its pin: to move it, edit its
# line first. The file's header stays.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

kept=$(mktemp)
trap 'rm -f "$kept"' EXIT
grep -E '^(#|torch==)' constraints.txt >"$kept"

rm -rf .venv
CONSTRAINTS=$kept bash tools/setup.sh
# A local version (torch's "+cpu") names one build of a release; the pin means any.
# open3d and open3d-cpu are one release under two names; pyproject.toml says which is taken where.
pins=$(.venv/bin/python -m pip freeze --exclude-editable | sed -e "s/+[a-z0-9.]*\$//" -e "s/^open3d-cpu\(==.*\)/&\nopen3d\1/")
{
    grep '^#' "$kept"
    LC_ALL=C sort --ignore-case <<<"$pins"
} >constraints.txt
touch .venv/.ready

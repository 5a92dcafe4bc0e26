#!/usr/bin/env bash
# Sees to a Chromium for the tests of the report's page, which are skipped where none is to be had.
# Environment: REQUIRE_BROWSER  if set, having none is a failure
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/system_packages.sh"

for name in chromium chromium-browser google-chrome chrome; do
    if command -v "$name" >/dev/null; then exit 0; fi
done
(install_system_packages chromium) || [ -z "${REQUIRE_BROWSER:-}" ] || fail "no Chromium, though REQUIRE_BROWSER is set"
command -v chromium >/dev/null || say "without Chromium the tests of the report's page are skipped"

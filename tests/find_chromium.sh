#!/bin/sh
# Prints the path of a Chromium for the browser tests: $CHROMIUM, one on the PATH, one that Debian's packages
# install (as root), or one that Playwright fetches. If none can be had it fails and says how to get one.
for name in "${CHROMIUM:-}" chromium chromium-browser google-chrome google-chrome-stable chrome; do
    [ -n "$name" ] && command -v "$name" && exit 0
done
for path in "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome" \
            "/Applications/Chromium.app/Contents/MacOS/Chromium"; do
    [ -x "$path" ] && echo "$path" && exit 0
done
if command -v apt-get > /dev/null && [ "$(id -u)" = 0 ]; then
    echo "no Chromium found; installing Debian's package" >&2
    { apt-get update -qq && apt-get install -y -qq --no-install-recommends chromium fonts-dejavu-core; } > /dev/null 2>&1
    command -v chromium && exit 0
fi
python=$(dirname "$0")/../.venv/bin/python
if [ -x "$python" ]; then
    echo "no Chromium found; fetching Playwright's" >&2
    "$python" -m playwright install chromium > /dev/null 2>&1
    "$python" -c 'from playwright.sync_api import sync_playwright as play
with play() as p: print(p.chromium.executable_path)' 2> /dev/null | { read -r path && [ -x "$path" ] && echo "$path"; } && exit 0
fi
cat >&2 <<'WORDS'
The browser tests need Chromium or Chrome, and none was found. Install one, for example
    Debian, Ubuntu   sudo apt-get install chromium
    Fedora           sudo dnf install chromium
    macOS            brew install --cask chromium
    Windows          winget install Google.Chrome
or say where it is:  CHROMIUM=/path/to/chromium make test
WORDS
exit 1

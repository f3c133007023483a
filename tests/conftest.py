"""What every test may ask for: the real surveys beside the repository, Chromium, and a data folder."""

from __future__ import annotations

from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SHARED = ROOT.parent / "shared"


def pytest_collection_modifyitems(items) -> None:
    """Where tests run in several processes a file stays whole, and browser tests share one server and wait for none."""
    for item in items:
        where = "browser" if item.path.parent.name == "ui" else item.path.name
        item.add_marker(pytest.mark.xdist_group(where))


@pytest.fixture(scope="session")
def root() -> Path:
    """The repository."""
    return ROOT


@pytest.fixture(scope="session")
def data() -> Path:
    """Files that come with the program."""
    return ROOT / "data"


@pytest.fixture(scope="session")
def shared() -> Path:
    """Files that lie beside the repository and are never committed; skips where they are absent."""
    if not SHARED.is_dir():
        pytest.skip("../shared is not here: real surveys and the contract are not part of the repository")
    return SHARED


@pytest.fixture(scope="session")
def real_surveys(shared) -> Path:
    """Real acoustic surveys with published answers."""
    return shared / "realdata"

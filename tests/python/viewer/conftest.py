"""A browser for the tests of the viewer's page."""

from __future__ import annotations

import pytest
from browser_pages import fetched_rules, viewed
from chromium import Chromium


@pytest.fixture(scope="module")
def browser():
    made = Chromium()
    yield made
    made.close()


@pytest.fixture
def paged(browser):
    with viewed(browser) as make:
        yield make


@pytest.fixture(scope="module")
def rules(tmp_path_factory):
    return fetched_rules(tmp_path_factory.mktemp("axe"))

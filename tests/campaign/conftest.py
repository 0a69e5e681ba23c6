"""A small campaign, and a folder that holds all of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from bumpstop.campaign import Campaign, load_campaign
from campaign.cases import computed, small


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    return load_campaign(small(tmp_path_factory.mktemp("campaign")))


@pytest.fixture(scope="module")
def whole(campaign: Campaign, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return computed(campaign, tmp_path_factory.mktemp("whole"))

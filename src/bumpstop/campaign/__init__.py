"""Campaigns: force distributions of many arms, tools, poses, motions, bodies and detectors."""

from bumpstop.campaign.campaign import Campaign
from bumpstop.campaign.campaign_file import load_campaign, parse_campaign
from bumpstop.campaign.estimate import Estimate, estimate

__all__ = ["Campaign", "Estimate", "estimate", "load_campaign", "parse_campaign"]

"""Campaigns: thousands of landings from a plan, in shards of JSON lines, and what they add up to."""

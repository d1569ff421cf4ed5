"""Charge stage: fills a domain with particles and gives each its platelet frame."""

"""Closed triangle surfaces: files, checks, inside and outside."""

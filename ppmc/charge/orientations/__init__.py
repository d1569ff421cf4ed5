"""A platelet frame for every particle: from CT, files, regions or by draw."""

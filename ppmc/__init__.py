"""Fibre orientation in compression-moulded prepreg platelets: CT, charge, flow and analysis."""

__version__ = "0.1.0"

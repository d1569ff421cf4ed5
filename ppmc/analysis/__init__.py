"""Analysis: region averages, path plots, views, tables and one report from orientation, charge and flow files.

The package is a set of small pure modules on arrays; only :mod:`ppmc.analysis.stage` touches disk. Nothing is
imported here so that ``ppmc --help`` stays fast; import the module of the idea you need, e.g.
``from ppmc.analysis.averages.averages import region_averages``.
"""

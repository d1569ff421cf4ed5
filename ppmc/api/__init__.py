"""The Python API: charges, flows and files as objects, on the same stage functions as the commands.

Its names are those of :mod:`ppmc` itself, which loads them when they are first used.
"""

"""Builds packs with the program kilwa on many machines: of one mesh in many Dask tasks, or of many meshes, one task each.

This package only schedules and reports. Everything that concerns geometry is done by the program kilwa, which workers run
as a subprocess.
"""

__version__ = "0.1.0"

"""Builds, checks and publishes collections of meshes with the program kilwa, one Dask task for each mesh.

This package only schedules and reports. Everything that concerns geometry is done by the program kilwa, which workers run
as a subprocess.
"""

__version__ = "0.1.0"

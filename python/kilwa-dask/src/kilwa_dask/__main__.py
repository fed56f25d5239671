"""Lets `python -m kilwa_dask` do the same as `kilwa-dask`."""

from kilwa_dask.cli import main

if __name__ == "__main__":
    raise SystemExit(main())

"""A small dataset of virtual patients, and three ways to load it: pandas, polars, Hugging Face datasets."""

import tempfile
from importlib.util import find_spec
from pathlib import Path

import pandas as pd

from mjhcmc import patients

folder = Path(tempfile.mkdtemp()) / "cohort"
configuration = patients.Configuration.with_defaults(2, seed=3, slow_deg_s=30.0, fast_deg_s="240")  # in a hurry
patients.generate(configuration, folder, progress=False)

people = pd.concat(map(pd.read_parquet, sorted(folder.glob("*/*/patients.parquet"))))
print(people[["patient", "split", "height", "ideal/hip", "ideal/knee", "ideal/ankle"]].to_string(index=False))

stretches = pd.read_parquet(next(folder.glob("train/*/observables.parquet")))
peak = stretches.groupby(["patient", "trial"]).torque.max().unstack()
print(f"pandas: peak torque of {peak.shape[1]} trials of {peak.shape[0]} patients")

if find_spec("polars"):
    import polars

    hidden = polars.scan_parquet(folder / "train/*/privileged.parquet")
    most = hidden.group_by("patient").agg(polars.col("reflex/vasti").max()).sort("patient").collect()
    print("polars: largest reflex of the vasti", most["reflex/vasti"].round(3).to_list())
else:
    print("polars is not installed: pip install polars")

if find_spec("datasets"):
    from datasets import load_dataset

    files = {"train": str(folder / "train/*/observables.parquet")}
    rows = load_dataset("parquet", data_files=files, cache_dir=str(folder.parent / "cache"))["train"]
    print(f"datasets: {rows.num_rows} rows, columns {', '.join(rows.column_names[:5])}, ...")
else:
    print("datasets is not installed: pip install datasets")

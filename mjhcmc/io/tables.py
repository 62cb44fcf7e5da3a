"""Solutions as tables: pandas, .parquet, .csv, OpenSim's .sto, and xarray's .nc."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mjhcmc.errors import MjhcmcError, OutputError
from mjhcmc.io.files import written_whole
from mjhcmc.log import get_logger
from mjhcmc.solution import Solution

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from mjhcmc.model import MuscleModel

SUFFIXES = (".parquet", ".csv", ".sto", ".nc")

_log = get_logger(__name__)

_EXTERNAL = "external"  # prefix of columns that are there only where a load acted from outside
_RESIDUAL = "residual"  # prefix of columns that are there only of degrees of freedom that can have one
_HOSTED = "hill_muscles"  # a column of ones where Hill muscles drove the model: a .csv has no other place for it
_INTEGRATOR = "integrator"  # prefix of a column that is there only where it was not RK4: the physics step, s
_FIBER = "fiber"  # prefix of columns that are there only of Hill muscles with compliant tendons
_META = "mjhcmc"  # key of the metadata in a file

_STATUS_NOTE = {
    "name": "status",
    "field_name": "status",
    "pandas_type": "int64",
    "numpy_type": "Int64",
    "metadata": None,
}

# column prefix: (attribute, one label a muscle, coordinate or dof, one row a node or a window)
_COLUMNS = {
    "q": ("qpos", "coordinate", "node"),
    "q_desired": ("qpos_desired", "coordinate", "node"),
    "qvel": ("qvel", "dof", "node"),
    "excitation": ("excitation", "muscle", "window"),
    "activation": ("activation", "muscle", "node"),
    "force": ("muscle_force", "muscle", "node"),
    "moment": ("net_joint_moment", "dof", "node"),
    "reserve": ("reserve", "dof", "window"),
    "shortfall": ("shortfall", "dof", "window"),
}


def to_dataframe(solution: Solution, detail: bool = False) -> pd.DataFrame:
    """See `Solution.to_dataframe`."""
    import pandas as pd

    data: dict[str, Any] = _table(solution)
    more = _detail_columns(solution) if detail else {}
    data["status"] = pd.array([*solution.status.tolist(), None], dtype="Int64")
    return pd.DataFrame({**data, **more})


def _detail_columns(solution: Solution) -> dict[str, NDArray[np.float64]]:
    """The columns that ``detail=True`` adds."""
    from mjhcmc.model_problems import joint_names_of

    found, muscles, dofs = solution.detail, solution.muscle_names, solution.dof_names
    assert solution.model is not None  # its detail is known
    joints, data = joint_names_of(solution.model.mj_model), {}
    for prefix, values in (
        ("fiber_length", found.fiber_length),
        ("fiber_velocity", found.fiber_velocity),
        ("power", found.muscle_power),
    ):
        data.update({f"{prefix}/{name}": values[:, i] for i, name in enumerate(muscles)})
    for j, dof in enumerate(dofs):
        data.update({f"contribution/{dof}/{name}": found.muscle_moment[:, i, j] for i, name in enumerate(muscles)})
    for prefix, values in (
        ("reaction_force", found.joint_reaction_force),
        ("reaction_moment", found.joint_reaction_moment),
    ):
        for j, joint in enumerate(joints):
            data.update({f"{prefix}/{joint}/{axis}": values[:, j, i] for i, axis in enumerate("xyz")})
    return data


def _table(solution: Solution) -> dict[str, NDArray[np.float64]]:
    """The columns of `to_dataframe`, all as floats, NaN where empty."""
    data = {"time": solution.time}
    for prefix, (attribute, labels, rows) in _COLUMNS.items():
        values = getattr(solution, attribute)
        if rows == "window":
            values = np.vstack([values, np.full((1, values.shape[1]), np.nan)])
        data.update({f"{prefix}/{name}": values[:, i] for i, name in enumerate(_names(solution, labels))})
    if solution.external_load.any():
        data.update({f"{_EXTERNAL}/{name}": solution.external_load[:, i] for i, name in enumerate(solution.dof_names)})
    for i in np.flatnonzero(solution.may_have_residual):
        data[f"{_RESIDUAL}/{solution.dof_names[i]}"] = solution.residual[:, i]
    if solution.hosted:
        data[_HOSTED] = np.ones(len(solution.time))
    if solution.integrator != "rk4":
        step = float(solution.settings["physics_dt"])
        data[f"{_INTEGRATOR}/{solution.integrator}"] = np.full(len(solution.time), step)
    if solution.fiber_length is not None:
        data.update({f"{_FIBER}/{name}": solution.fiber_length[:, i] for i, name in enumerate(solution.muscle_names)})
    data["status"] = np.append(solution.status.astype(np.float64), np.nan)
    return data


def _names(solution: Solution, labels: str) -> tuple[str, ...]:
    return {
        "muscle": solution.muscle_names,
        "coordinate": solution.coordinate_names,
        "dof": solution.dof_names,
    }[labels]


def to_xarray(solution: Solution) -> xr.Dataset:
    """See `Solution.to_xarray`."""
    try:
        import xarray as xr
    except ImportError as error:
        raise OutputError('xarray is not installed: pip install "mjhcmc[netcdf]"') from error

    variables: dict[str, Any] = {"status": ("window", solution.status)}
    alike = solution.coordinate_names == solution.dof_names  # then one dimension does for both
    for attribute, labels, rows in _COLUMNS.values():
        over = "dof" if alike and labels == "coordinate" else labels
        variables[attribute] = ((rows, over), getattr(solution, attribute))
    if solution.external_load.any():
        variables["external_load"] = (("node", "dof"), solution.external_load)
    if solution.may_have_residual.any():
        variables["residual"] = (("node", "dof"), solution.residual)
    if solution.fiber_length is not None:
        variables["fiber_length"] = (("node", "muscle"), solution.fiber_length)
    variables["dof_is_rotation"] = ("dof", solution.dof_is_rotation)
    coordinates = {
        "time": ("node", solution.time),
        "muscle": ("muscle", list(solution.muscle_names)),
        "dof": ("dof", list(solution.dof_names)),
    }
    if not alike:
        coordinates["coordinate"] = ("coordinate", list(solution.coordinate_names))
    return xr.Dataset(variables, coordinates)


def save_solution(solution: Solution, path: Path) -> Path:
    """See `Solution.save`."""
    _save(solution, path)
    _log.info("solution written: %s, %d rows", path, len(solution.time))
    return path


def _save(solution: Solution, path: Path) -> None:
    suffix = _suffix(path)
    meta = json.dumps(_metadata(solution), default=_plain) if suffix != ".csv" else ""
    if suffix == ".sto":
        from mjhcmc.io.opensim import write_table

        data = _table(solution)
        time = data.pop("time")
        write_table(
            path, list(data), time, np.column_stack(list(data.values())),
            name="mjhcmc solution", in_degrees=False, extra={_META: meta},
        )  # fmt: skip
        return
    with written_whole(path) as temporary:
        if suffix == ".parquet":
            import pyarrow as pa
            import pyarrow.parquet as pq

            arrow = {name: pa.array(values, from_pandas=True) for name, values in _table(solution).items()}
            arrow["status"] = arrow["status"].cast(pa.int64())
            # straight to Arrow: pandas takes most of a second to import; the note makes it read status as integers
            note = {"index_columns": [], "column_indexes": [], "columns": [_STATUS_NOTE], "pandas_version": "2.0.0"}
            table = pa.table(arrow).replace_schema_metadata({"pandas": json.dumps(note), _META: meta})
            pq.write_table(table, temporary)
        elif suffix == ".csv":
            to_dataframe(solution).to_csv(temporary, index=False)
        else:
            to_xarray(solution).assign_attrs({_META: meta}).to_netcdf(temporary, engine="scipy")


def load_solution(path: Path, model: MuscleModel | str | Path | None = None) -> Solution:
    """See `Solution.load`."""
    from mjhcmc.io.with_model import with_model
    from mjhcmc.model import MuscleModel

    known = None if model is None else MuscleModel.load(model)
    solution = _load(path)
    if known is not None:
        solution = with_model(solution, known, path)
    _log.info("solution read: %s, %d rows, %d muscles", path, len(solution.time), len(solution.muscle_names))
    _log.debug("settings of the solution in %s: %s", path, solution.settings)
    return solution


def _load(path: Path) -> Solution:
    suffix = _suffix(path)
    try:
        if not path.is_file():
            raise OutputError(f"{path}: no such file: check the path")
        if suffix == ".nc":
            return _from_netcdf(path)
        meta: dict[str, Any] = {}
        if suffix == ".parquet":
            import pyarrow.parquet as pq

            table = pq.read_table(path)
            meta = json.loads((table.schema.metadata or {}).get(_META.encode(), b"{}"))
            columns = {name: table[name].to_numpy().astype(float) for name in table.column_names}
        elif suffix == ".csv":
            import pandas as pd

            frame = pd.read_csv(path, dtype=str)  # as text: NumPy reads every digit, pandas may not
            columns = {name: frame[name].to_numpy(dtype=object).astype(float) for name in frame.columns}
        else:
            from mjhcmc.io.opensim import read_table

            read = read_table(path)
            meta = json.loads(read.header.get(_META, "{}"))
            columns = {"time": read.time, **dict(zip(read.columns, read.values.T, strict=True))}
        return _from_columns(columns, meta)
    except MjhcmcError as error:
        raise OutputError(f"{path}: {error}" if str(path) not in str(error) else str(error)) from error
    except Exception as error:  # a damaged file may break its reader (pyarrow, pandas, scipy) in any way
        first = next((line.strip() for line in str(error).splitlines() if line.strip()), type(error).__name__)
        raise OutputError(f"{path}: is no solution that mjhcmc wrote ({first}): solve and save it again") from error


def _suffix(path: Path) -> str:
    if path.suffix.lower() not in SUFFIXES:
        raise OutputError(f"{path}: unknown suffix {path.suffix!r}: use one of {', '.join(SUFFIXES)}")
    return path.suffix.lower()


def _metadata(solution: Solution) -> dict[str, Any]:
    return {
        "settings": solution.settings,
        "interrupted": solution.interrupted,
        "dof_is_rotation": solution.dof_is_rotation.tolist(),
        "verdict": solution.verdict.to_dict(),
    }


def _plain(value: Any) -> Any:
    """For JSON: a setting may be NumPy's number or array."""
    return value.tolist() if isinstance(value, (np.generic, np.ndarray)) else str(value)


def _from_columns(columns: dict[str, NDArray[np.float64]], meta: dict[str, Any]) -> Solution:
    labels: dict[str, list[str]] = {prefix: [] for prefix in _COLUMNS}
    for column in columns:
        prefix, slash, label = column.partition("/")
        if slash and prefix in labels:
            labels[prefix].append(label)
    arrays: dict[str, NDArray[np.float64]] = {}
    for prefix, (attribute, _, rows) in _COLUMNS.items():
        if not labels[prefix]:
            raise OutputError(f"no column {prefix}/...: is no solution that mjhcmc wrote")
        values = np.column_stack([columns[f"{prefix}/{label}"] for label in labels[prefix]])
        if rows == "window":
            if len(values) and not np.isnan(values[-1]).all():
                raise OutputError(f"the last row has {prefix}/{labels[prefix][0]}, but no window begins there: cut off")
            values = values[:-1]
        arrays[attribute] = values
    dofs = tuple(labels["moment"])
    if any(column.startswith(f"{_EXTERNAL}/") for column in columns):
        arrays["external_load"] = np.column_stack([columns[f"{_EXTERNAL}/{dof}"] for dof in dofs])
    if any(column.startswith(f"{_RESIDUAL}/") for column in columns):
        none = np.zeros(len(columns["time"]))
        arrays["residual"] = np.column_stack([columns.get(f"{_RESIDUAL}/{dof}", none) for dof in dofs])
    if "settings" not in meta:
        dt = float(columns["time"][-1] - columns["time"][0]) / max(1, len(columns["time"]) - 1)
        hosted = {"muscles": {"named": False}} if _HOSTED in columns else {}
        meta = {**meta, "settings": {"dt": dt, **hosted, **_stepped_by(columns), **_roles_from(columns, dofs)}}
    muscles = tuple(labels["activation"])
    if any(column.startswith(f"{_FIBER}/") for column in columns):
        arrays["fiber_length"] = np.column_stack([columns[f"{_FIBER}/{muscle}"] for muscle in muscles])
    return _assemble(arrays, columns["time"], columns["status"][:-1], muscles, tuple(labels["q"]), dofs, meta)


def _stepped_by(columns: dict[str, NDArray[np.float64]]) -> dict[str, Any]:
    """Integrator and physics step, as settings, of a table that holds none (a .csv); nothing where RK4 stepped."""
    from mjhcmc.integrators import scheme_of

    for column, values in columns.items():
        prefix, slash, name = column.partition("/")
        if slash and prefix == _INTEGRATOR:
            step = float(values[0])
            if not (np.isfinite(step) and step > 0 and (values == step).all()):
                raise OutputError(f"column {column} holds no physics step: solve and save again")
            return {"integrator": scheme_of(name).name, "physics_dt": step}
    return {}


def _roles_from(columns: dict[str, NDArray[np.float64]], dofs: tuple[str, ...]) -> dict[str, Any]:
    """Roles, as settings, of a table that holds none (a .csv): a residual without reserve is of what is prescribed."""
    roles, root = ["tracked"] * len(dofs), []
    for i, dof in enumerate(dofs):
        if f"{_RESIDUAL}/{dof}" in columns:
            if np.nan_to_num(columns[f"reserve/{dof}"]).any():
                root.append(dof)
            else:
                roles[i] = "prescribed"
    return {name: value for name, value in (("roles", roles), ("root", root)) if set(value) - {"tracked"}}


def _from_netcdf(path: Path) -> Solution:
    try:
        import xarray as xr
    except ImportError as error:
        raise OutputError(f'{path}: xarray is not installed: pip install "mjhcmc[netcdf]"') from error
    with xr.open_dataset(path, engine="scipy", mmap=False) as data:
        data.load()
    arrays = {attribute: data[attribute].to_numpy() for attribute, _, _ in _COLUMNS.values()}
    for name in ("external_load", "residual", "fiber_length"):
        if name in data:
            arrays[name] = data[name].to_numpy()
    muscles, coordinates, dofs = (
        tuple(str(name) for name in data[key if key in data else "dof"].to_numpy())
        for key in ("muscle", "coordinate", "dof")
    )
    return _assemble(
        arrays,
        data["time"].to_numpy(),
        data["status"].to_numpy(),
        muscles,
        coordinates,
        dofs,
        json.loads(data.attrs.get(_META, "{}")),
    )


def _assemble(
    arrays: dict[str, NDArray[np.float64]],
    time: NDArray[np.float64],
    status: NDArray[Any],
    muscle_names: tuple[str, ...],
    coordinate_names: tuple[str, ...],
    dof_names: tuple[str, ...],
    meta: dict[str, Any],
) -> Solution:
    from mjhcmc.coordinate_names import NamedCoordinates
    from mjhcmc.verify import Verdict

    arrays = {"external_load": np.zeros_like(arrays["net_joint_moment"]), **arrays}
    floats: dict[str, Any] = {name: np.array(values, dtype=np.float64, order="C") for name, values in arrays.items()}
    for name, values in {"time": time, "status": status, **floats}.items():
        bad = np.argwhere(~np.isfinite(values))
        if len(bad):
            raise OutputError(f"row {bad[0][0]} (from 0) of {name} holds {values[tuple(bad[0])]}: solve and save again")
    if len(time) < 2:
        raise OutputError(f"{len(time)} rows: a solution has at least 2")
    rotation = meta.get("dof_is_rotation", [True] * len(dof_names))
    difference = NamedCoordinates(coordinate_names, dof_names).difference
    return Solution(
        time=np.array(time, dtype=np.float64),
        tracking_error=difference(floats["qpos"], floats["qpos_desired"]),
        status=np.array(status, dtype=np.int64),
        muscle_names=muscle_names,
        coordinate_names=coordinate_names,
        dof_names=dof_names,
        dof_is_rotation=np.array(rotation, dtype=bool),
        settings=meta.get("settings", {"dt": float(time[-1] - time[0]) / (len(time) - 1)}),
        interrupted=meta.get("interrupted", False),
        stored_verdict=Verdict.from_dict(meta["verdict"]) if "verdict" in meta else None,
        **floats,
    )

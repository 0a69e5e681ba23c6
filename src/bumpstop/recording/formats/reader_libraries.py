"""What the reader's process does with the libraries for Parquet, Excel and MATLAB files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from bumpstop.errors import InputError
from bumpstop.recording.formats.csv import are_numbers

if TYPE_CHECKING:
    import polars as pl

Answer = tuple[dict[str, Any], list[npt.NDArray[Any]]]
_DAMAGED = "the file may be damaged or cut short"


def parquet(path: Path, shown: str, columns: list[str] | None, rows: int | None) -> Answer:
    """Names, types, metadata and rows of a Parquet file; or some of its columns as numbers.

    Args:
        path: of the file.
        shown: how errors call it.
        columns: names; None: what the file says of itself.
        rows: that it says of itself, where columns are wanted.
    """
    import polars as pl

    try:
        # Polars takes no path that is not UTF-8, and a bracket in one for a pattern.
        if columns is not None:
            with path.open("rb") as file:
                found = pl.read_parquet(file, columns=sorted(set(columns)))
            if found.height != rows:
                problem = f"cannot be read as Parquet (it says that it has {rows} rows, and has {found.height})"
                raise InputError(shown, problem, _DAMAGED)
            return {}, _numbers(found, columns)
        with path.open("rb") as file:
            table = pl.scan_parquet(file)
            schema = table.collect_schema()
            count = int(table.select(pl.len()).collect().item())
        with path.open("rb") as file:
            said = pl.read_parquet_metadata(file)
    except InputError:
        raise
    except Exception as error:  # polars raises many kinds for a damaged file
        raise _damaged(shown, "Parquet", error) from None
    numeric = [kind.is_numeric() for kind in schema.values()]
    said = {key: said[key] for key in ("joint_names", "robot") if key in said}
    return {"names": list(schema), "numeric": numeric, "rows": count, "said": said}, []


def excel(path: Path, shown: str, header: bool | None) -> Answer:
    """Names of the first sheet of an Excel file, and its columns as numbers; of others the type instead.

    Args:
        path: of the file.
        shown: how errors call it.
        header: whether its first row holds names; None: when most of its cells are no numbers.
    """
    import polars as pl

    def read(named: bool) -> pl.DataFrame:
        return pl.read_excel(path.read_bytes(), engine="calamine", has_header=named, infer_schema_length=None)

    named = header is not False
    try:
        table = read(named)
        # A number that stands twice in the first row comes as a name with this ending.
        if header is None and are_numbers([name.partition("_duplicated_")[0] for name in table.columns]):
            named, table = False, read(False)
    except ModuleNotFoundError:
        raise InputError(
            shown, "is an Excel file, which needs the package fastexcel", "pip install fastexcel"
        ) from None
    except Exception as error:  # of polars or of calamine
        raise _damaged(shown, "Excel", error) from None
    kinds, arrays = [], []
    for name in table.columns:
        try:
            arrays += _numbers(table, [name])
            kinds.append("")
        except InputError as error:
            arrays.append(np.zeros(0))
            kinds.append(error.problem)
    return {"names": table.columns, "named": named, "rows": table.height, "problems": kinds}, arrays


def matlab(path: Path, shown: str) -> Answer:
    """Names of the variables of a MATLAB file, and the matrices of numbers among them.

    Args:
        path: of a file of MATLAB 5 to 7.2.
        shown: how errors call it.
    """
    import scipy.io

    try:
        loaded = scipy.io.loadmat(path, simplify_cells=True)
    except NotImplementedError:
        raise InputError(shown, "is a MATLAB 7.3 file", "save it with -v7") from None
    except MemoryError:
        raise
    except Exception as error:  # scipy raises many kinds for a damaged file
        reason = (str(error).splitlines() or [type(error).__name__])[0][:120]
        raise InputError(shown, f"cannot be read as MATLAB file ({reason})", "it may be damaged") from None
    flat: dict[str, Any] = {}
    _flatten({key: value for key, value in loaded.items() if not str(key).startswith("__")}, "", flat)
    arrays = {name: np.asarray(value) for name, value in flat.items()}
    numeric = {name: array for name, array in arrays.items() if array.dtype.kind in "fiu"}
    return {"names": list(arrays), "numeric": list(numeric)}, list(numeric.values())


def _flatten(value: Any, name: str, flat: dict[str, Any]) -> None:
    if isinstance(value, dict):
        for key, inner in value.items():
            _flatten(inner, f"{name}.{key}" if name else str(key), flat)
    else:
        flat[name] = value


def _numbers(table: pl.DataFrame, names: list[str]) -> list[npt.NDArray[Any]]:
    import polars as pl

    found: list[npt.NDArray[Any]] = []
    for name in names:
        column = table[name]
        if column.dtype == pl.String:
            column = column.str.strip_chars()
        elif not (column.dtype.is_numeric() or column.dtype == pl.Null):
            raise InputError(f"column {name!r}", f"holds {column.dtype}, not numbers", "wanted numbers")
        found.append(column.cast(pl.Float64, strict=False).fill_null(np.nan).to_numpy())
    return found


def _damaged(shown: str, kind: str, error: Exception) -> InputError:
    reason = (str(error).splitlines() or [type(error).__name__])[0][:120]
    return InputError(shown, f"cannot be read as {kind} ({reason})", _DAMAGED)

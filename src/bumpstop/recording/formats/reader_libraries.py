"""What the reader's process does with the libraries for Parquet, Excel and MATLAB files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from bumpstop.errors import InputError
from bumpstop.recording.formats.csv import are_numbers, are_text

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
    said = {key: said[key] for key in ("joint_names", "robot", "found_with") if key in said}
    return {"names": list(schema), "numeric": numeric, "rows": count, "said": said}, []


def excel(path: Path, shown: str, header: bool | None) -> Answer:
    """Names of the first sheet of an Excel file, and its columns as numbers; of others the type instead.

    The last array holds the numbers of the rows, from 1 as Excel shows them; rows without any cell are left out.

    Args:
        path: of the file.
        shown: how errors call it.
        header: whether its first row holds names; None: when most of its cells are no numbers.
    """
    try:
        body = path.read_bytes()
        before, fields = _first_row(body, shown)
        named = header is True or (header is None and not are_numbers(fields))
        begin = before + named
        table = _sheet(body, begin)
    except InputError:
        raise
    except ModuleNotFoundError:
        raise InputError(
            shown, "is an Excel file, which needs the package fastexcel", "pip install fastexcel"
        ) from None
    except Exception as error:  # of polars or of calamine
        raise _damaged(shown, "Excel", error) from None
    filled = np.zeros(table.height, dtype=bool)
    for column in table:
        filled |= column.is_not_null().to_numpy()
    if not filled.any():
        raise InputError(shown, "has no row of data", "wanted rows of numbers")
    kinds, arrays = [], []
    for label in table.columns:
        try:
            arrays += [column[filled] for column in _numbers(table, [label])]
            kinds.append("")
        except InputError as error:
            arrays.append(np.zeros(0))
            kinds.append(error.problem)
    rows = np.flatnonzero(filled) + begin + 1
    top = [_text(cell) for cell in table.row(int(rows[0]) - begin - 1)]
    answer = {
        "names": fields,
        "named": named,
        "problems": kinds,
        "text_row": top if are_text(top) else [],
    }
    return answer, [*arrays, rows.astype(np.int64)]


def _sheet(body: bytes, begin: int, rows: int | None = None) -> pl.DataFrame:
    """The rows of the first sheet after so many, with all of its columns, and empty rows, too."""
    import polars as pl

    # Polars gives a name that stands twice another ending: names are taken from the cells instead.
    return pl.read_excel(
        body,
        engine="calamine",
        has_header=False,
        infer_schema_length=None,
        drop_empty_rows=False,
        drop_empty_cols=False,
        raise_if_empty=False,
        read_options={"skip_rows": begin} if rows is None else {"skip_rows": begin, "n_rows": rows},
    )


def _first_row(body: bytes, shown: str) -> tuple[int, list[str]]:
    """How many empty rows stand before the first that is not, and what stands in that."""
    count = 1
    while True:
        table = _sheet(body, 0, count)
        for before, row in enumerate(table.iter_rows()):
            if any(cell is not None for cell in row):
                return before, [_text(cell) for cell in row]
        if table.height < count:
            raise InputError(shown, "is empty", "wanted rows of numbers")
        count *= 64


def _text(cell: Any) -> str:
    return "" if cell is None else str(cell).strip()


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

"""States in files of their own, for runs that a script continues."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from .._files import aside, open_regular, write_all
from .state import State, contents, rebuilt


def save_state(path: str | Path, state: State) -> None:
    """Write a state to an ``.npz`` file, aside and renamed, so that it is never half written.

    Parameters
    ----------
    path : str or Path
        The file.
    state : State
        What to keep.

    Examples
    --------
    >>> import tempfile
    >>> place = Path(tempfile.mkdtemp()) / "state.npz"
    >>> x = np.ones(2)
    >>> save_state(place, State(t=0.5, step=1, dt=0.5, u=x, v=x, a=x, work=0.0, initial=1.0))
    >>> load_state(place).u.tolist()
    [1.0, 1.0]
    """
    path = Path(path)
    numbers, vectors, broken = contents(state)
    content: dict[str, Any] = {name: np.asarray(value) for name, value in (numbers | vectors).items()}
    content |= {f"broken_{k}": bonds for k, bonds in enumerate(broken or ())}
    whole = io.BytesIO()
    np.savez(whole, **content)
    with aside(path) as file:
        write_all(file, whole.getbuffer())


def load_state(path: str | Path) -> State:
    """Read a state that :func:`save_state` wrote, to continue from with ``start=`` of its scheme.

    Nothing is unpickled.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    State
        The state.

    Raises
    ------
    ValueError
        For a file that is none.

    Examples
    --------
    >>> import tempfile
    >>> place, x = Path(tempfile.mkdtemp()) / "state.npz", np.ones(2)
    >>> save_state(place, State(t=0.5, step=1, dt=0.5, u=x, v=x, a=x, work=0.0, initial=1.0))
    >>> load_state(place).t
    0.5
    """
    try:
        with open_regular(path) as raw, np.load(raw, allow_pickle=False) as file:
            numbers = {name: file[name].item() for name in (*State.NUMBERS, "spent") if name in file}
            vectors = {name: file[name] for name in (*State.VECTORS, "tangent") if name in file}
            lists = sum(name.startswith("broken_") for name in file)
            return rebuilt(State, numbers, vectors, [file[f"broken_{k}"] for k in range(lists)] or None)
    except (KeyError, TypeError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise ValueError(f"{str(path)!r} is not a state that save_state wrote: {error}") from None

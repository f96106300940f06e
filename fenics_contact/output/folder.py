"""Files of a result appear in their folder complete, or not at all."""

from __future__ import annotations

import logging
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from secrets import token_hex

from fenics_contact.errors import ContactError, OutputError, raised_together
from fenics_contact.parallel import MPI

_log = logging.getLogger("fenics_contact")


class DrawingError(OutputError):
    """A picture cannot be drawn, whatever the disk has to say; the message names both."""


@contextmanager
def drawing(name: str) -> Iterator[None]:
    """Name the picture that cannot be drawn.

    Raises:
        DrawingError: Whatever went wrong, but for a file that cannot be written.
    """
    try:
        yield
    except (OSError, ContactError):
        raise
    except Exception as error:
        reason = " ".join(str(error).split())
        text = f"{name} could not be drawn ({type(error).__name__}: {reason})"
        raise DrawingError(text) from error


@contextmanager
def going_on(lost: list[str]) -> Iterator[None]:
    """Go on without a picture that cannot be drawn: note that, and warn. Collective."""
    try:
        yield
    except DrawingError as error:
        lost.append(str(error))
        _log.warning("warning: %s", error)


def cannot_write(folder: Path, reason: Exception) -> OutputError:
    """That a folder cannot be written to, with the reason."""
    other = "choose another folder (-o on the command line)"
    return OutputError(f"cannot write to '{folder}': {reason}; {other}")


def replace_file(target: Path, data: bytes) -> None:
    """Write a file that is complete whenever it is there.

    Raises:
        OSError: If it cannot be written; nothing is left then.
    """
    unfinished = target.with_name(f".writing-{token_hex(4)}")
    try:
        with unfinished.open("xb") as file:  # a new one: never through a link
            file.write(data)
        os.replace(unfinished, target)
    except OSError:
        with suppress(OSError):  # a disk that is read-only says so once more
            unfinished.unlink(missing_ok=True)
        raise


@contextmanager
def writing(comm: MPI.Comm, folder: Path | None = None) -> Iterator[None]:
    """Raise what goes wrong with a file on one rank on all of them; see `raised_together`.

    Raises:
        OutputError: On all ranks, with the reason, and the folder if it is given.
    """
    with raised_together(comm):
        try:
            yield
        except OSError as error:
            reason = OutputError(error.strerror or str(error))
            raise (cannot_write(folder, reason) if folder else reason) from None


@contextmanager
def filled_at_once(folder: Path, last: str, comm: MPI.Comm) -> Iterator[Path]:
    """A hidden folder to write to, whose files are moved to `folder` at the end; one of them last.

    Collective. If anything goes wrong before, `folder` is as it was.

    Raises:
        OutputError: On all ranks, if a file or folder cannot be made.
    """
    hidden: Path | None = None
    made: list[Path] = []
    try:
        with writing(comm):
            if comm.rank == 0:
                made = [path for path in (folder, *folder.parents) if not path.exists()]
                folder.mkdir(parents=True, exist_ok=True)
                hidden = Path(tempfile.mkdtemp(prefix=".writing-", dir=folder))
        place: Path = comm.bcast(hidden)
        yield place
        with writing(comm):
            if comm.rank == 0:
                _move(place, folder, last)
                made = []
    except OutputError as error:
        raise cannot_write(folder, error) from None
    finally:
        if comm.rank == 0:
            if hidden is not None:
                shutil.rmtree(hidden, ignore_errors=True)
            for path in made:  # those that are empty
                with suppress(OSError):
                    path.rmdir()


def _move(hidden: Path, folder: Path, last: str) -> None:
    """Move all files; without the one that comes last, those in the folder are of two results.

    Raises:
        OutputError: If a folder has the name of a file; nothing is moved then.
    """
    for path in hidden.iterdir():
        if path.is_file() and (folder / path.name).is_dir():
            raise OutputError(f"'{path.name}' is a folder there")
    (folder / last).unlink(missing_ok=True)
    for path in sorted(hidden.iterdir(), key=lambda path: path.name == last):
        os.replace(path, folder / path.name)

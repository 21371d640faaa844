"""The files to read and write: lists, folders, wildcards, standard streams."""

from __future__ import annotations

import argparse
import contextlib
import glob
import logging
import os
import tempfile
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

from o3d_sofnn.cli.messages import Messages

STREAM = "-"
"""The name of the standard streams."""


STEM = "{stem}"
"""Stands in OUT for the name of IN without its folder and extension."""


_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Job:
    """A file to read and one to write.

    Attributes
    ----------
    source, target : pathlib.Path
        The files; temporary ones for the standard streams.
    ending : str or None
        Format of ``source``; None if its name determines it.
    is_from_stream, is_to_stream : bool
        Whether ``source`` and ``target`` represent the standard streams.
    """

    source: Path
    target: Path
    ending: str | None = None
    is_from_stream: bool = False
    is_to_stream: bool = False

    @property
    def report(self) -> dict[str, str]:
        """Return the names of the files as the user gave them."""
        return {
            "input": STREAM if self.is_from_stream else str(self.source),
            "output": STREAM if self.is_to_stream else str(self.target),
        }


@dataclass(frozen=True)
class Plan:
    """The jobs of a call.

    Attributes
    ----------
    jobs : tuple of Job
        The jobs, at least one.
    several : bool
        Whether OUT is a folder or a pattern; if so, a failure does not stop the other jobs.
    """

    jobs: tuple[Job, ...]
    several: bool


@contextlib.contextmanager
def planned(args: argparse.Namespace, messages: Messages) -> Iterator[Plan]:
    """Plan the jobs, with temporary files for the standard streams and a folder for outputs.

    Parameters
    ----------
    args : argparse.Namespace
        ``input``, ``output``, ``input_format``, ``output_format``, ``json``, ``command``.
    messages : Messages
        Is told the names of the temporary files of the standard streams.

    Yields
    ------
    Plan
        The plan. A folder that was created for it is removed at the end if it is empty.

    Raises
    ------
    ValueError
        There is nothing to read, formats or names do not fit, or an output is an input.
    OSError
        The folder cannot be created.
    """
    from o3d_sofnn.files import point_files

    if not args.output:
        raise ValueError("OUT: expected a name, got an empty one")
    is_mesh = args.command == "reconstruct"
    endings = point_files.MESH_OUTPUTS if is_mesh else point_files.CLOUD_OUTPUTS
    read_as = input_ending(args.input_format)
    output_ending = _ending("output-format", args.output_format, endings)
    with contextlib.ExitStack() as stack:
        read_from = write_to = Path()
        if STREAM in (*args.input, args.output):
            _check_streams(args)
            made = tempfile.TemporaryDirectory(prefix="o3d-sofnn-", ignore_cleanup_errors=True)
            scratch = Path(stack.enter_context(made))
            read_from = scratch / f"stdin{read_as or ''}"
            write_to = scratch / f"stdout{output_ending or ''}"
            messages.names |= {str(read_from): "standard input", str(write_to): "standard output"}
        names = found(args.input, read_as)
        sources = [read_from if text == STREAM else Path(text) for text in names]
        several = _are_several(args.output, len(sources), endings)
        if several:
            targets = _targets(args.output, sources, output_ending)
        else:
            is_stream = args.output == STREAM
            targets = [write_to if is_stream else _target(args.output, output_ending)]
        reports = [] if args.json in (None, STREAM) else [args.json]
        point_files.check_different(sources, [*targets, *reports])
        if several and STEM not in args.output:
            stack.enter_context(_made(Path(args.output)))
        jobs = tuple(
            Job(source, target, read_as, text == STREAM, args.output == STREAM)
            for text, source, target in zip(names, sources, targets, strict=True)
        )
        yield Plan(jobs, several)


def input_ending(name: str | None) -> str | None:
    """Return the extension of the format that ``--input-format`` names."""
    from o3d_sofnn.files import point_files

    return _ending("input-format", name, point_files.CLOUD_INPUTS)


def _ending(option: str, name: str | None, known: Collection[str]) -> str | None:
    """Return the extension of a format that the user named."""
    if name is None:
        return None
    ending = f".{name.lower().removeprefix('.')}"
    if ending not in known:
        names = " ".join(sorted(each[1:] for each in known))
        raise ValueError(f"--{option}: expected one of {names}, got {name}")
    return ending


def _check_streams(args: argparse.Namespace) -> None:
    """Raise ``ValueError`` if a standard stream cannot be used."""
    if STREAM in args.input and args.input_format is None:
        raise ValueError("--input-format: expected the format of the standard input, got none")
    if args.input.count(STREAM) > 1:
        raise ValueError("IN: expected the standard input once, got it twice")
    if args.output != STREAM:
        return
    if args.output_format is None:
        raise ValueError("--output-format: expected the format of the standard output, got none")
    for option, value in (("--json", args.json == STREAM), ("--progress", args.progress)):
        if value in (True, "plain"):
            raise ValueError(f"{option}: expected something else, as OUT is the standard output")


def found(inputs: list[str], ending: str | None) -> list[str]:
    """Return the files of the inputs, including those in folders and those matching wildcards."""
    files: dict[str, None] = {}
    for text in inputs:
        matches = [text]
        if text != STREAM and not os.path.lexists(text) and glob.has_magic(text):
            # Brackets may be part of a name: what matches nothing is the name of a missing file.
            matches = sorted(glob.glob(text, recursive=True)) or matches
        for match in matches:
            is_folder = match != STREAM and os.path.isdir(match)
            files |= dict.fromkeys(_in_folder(match, ending) if is_folder else [match])
    return list(files)


def _in_folder(folder: str, ending: str | None) -> list[str]:
    """Return the point files directly in a folder."""
    from o3d_sofnn.files import point_files

    known = point_files.CLOUD_INPUTS if ending is None else {ending}
    files = [f for f in sorted(Path(folder).iterdir()) if f.is_file() and f.name[0] != "."]
    others = sorted({f.suffix for f in files if f.suffix.lower() not in known})
    found = [str(f) for f in files if f.suffix.lower() in known]
    if not found:
        raise ValueError(f"{folder}: expected point files in it, got none")
    if others:
        kinds = " ".join(each or "(no ending)" for each in others)
        _logger.warning("%s: left out, as no point files: %s", folder, kinds)
    return found


def _are_several(output: str, count: int, endings: Collection[str]) -> bool:
    """Return whether OUT is a folder or a pattern, for any number of inputs."""
    separators = tuple(each for each in (os.sep, os.altsep) if each)
    if STEM in output or output.endswith(separators):
        return True
    if output != STREAM and Path(output).suffix.lower() not in endings:
        is_new = not os.path.lexists(output) and not Path(output).suffix
        if os.path.isdir(output) or (is_new and count > 1):
            return True
    if count > 1:
        shown = "the standard output" if output == STREAM else output
        raise ValueError(
            f"OUT: expected a folder or a name with {STEM} for {count} files, got {shown}"
        )
    return False


def _target(output: str, ending: str | None) -> Path:
    """Return the single file to write."""
    path = Path(output)
    said = path.suffix.lower()
    if ending is not None and ending != said:
        raise ValueError(
            f"--output-format: expected {said[1:] or 'an OUT with an ending'} as OUT is {output}, "
            f"got {ending[1:]}"
        )
    return path


def _targets(output: str, sources: list[Path], ending: str | None) -> list[Path]:
    """Return the files to write for a pattern or a folder."""
    pattern = output
    if STEM not in output:
        pattern = os.path.join(output, f"{STEM}{ending or '.ply'}")
    elif ending not in (None, Path(output).suffix.lower()):
        raise ValueError(f"--output-format: expected the ending of {output}, got {ending}")
    targets: dict[Path, Path] = {}
    for source in sources:
        target = Path(pattern.replace(STEM, source.stem))
        if target in targets:
            raise ValueError(
                f"{target}: expected one IN for it, got {targets[target]} and {source}"
            )
        targets[target] = source
    return list(targets)


@contextlib.contextmanager
def _made(folder: Path) -> Iterator[None]:
    """Create a folder, and remove it at the end if it is empty."""
    if folder.is_dir():
        yield
        return
    folder.mkdir()
    try:
        yield
    finally:
        with contextlib.suppress(OSError):  # it has files
            folder.rmdir()

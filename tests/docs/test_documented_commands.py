"""The commands and code in the documentation work."""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from documented_code import DOCS, ROOT, Block, blocks, pages
from stage import QUICK, Stage, run_command

from batch_recordings import Pretending
from command_line import leave_out
from ospc.cli.main import cli
from ospc.correspondence.features import EXTRACTORS
from ospc.correspondence.registration import REGISTRARS
from ospc.estimation.response_basis import FUNCTIONS
from ospc.settings import presets

README = ROOT / "README.md"
ELSEWHERE = {DOCS / "state.md", DOCS / "scaling.md"} | set((DOCS / "experiments").glob("*.md"))
"""Pages whose commands take hours or are tested elsewhere."""

RUN = [
    page
    for page in [*pages(), README]
    if page not in ELSEWHERE and any(not b.not_run and (b.commands or b.language == "python") for b in blocks(page))
]

FEWER_FRAMES = {"demo": ["--frames", "8"], "simulate": ["--frames", "24", "--size", "192x144"]}
"""Options appended to commands; the last value counts. Other tests use the full number of frames."""


@pytest.fixture(scope="session")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Stage:
    return Stage(tmp_path_factory.mktemp("stage"))


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch, one_room: None) -> None:
    monkeypatch.setitem(presets.PRESETS, "default", QUICK)


@pytest.fixture(autouse=True)
def tables_as_before() -> Iterator[None]:
    """Remove names registered by a page after its test."""
    before = [(table, set(table)) for table in (EXTRACTORS, REGISTRARS, FUNCTIONS)]
    yield
    for table, names in before:
        for name in set(table) - names:
            del table[name]


def name_of(page: Path) -> str:
    return str(page.relative_to(ROOT))


@pytest.mark.parametrize("page", RUN, ids=name_of)
def test_the_code_on_a_page_works(page: Path, stage: Stage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    to_run = [block for block in blocks(page) if not block.not_run]
    monkeypatch.chdir(tmp_path)
    stage.set_for("\n".join(block.text for block in to_run), tmp_path)
    names: dict[str, object] = {"__name__": "page"}
    for block in to_run:
        try:
            _run(block, names)
        except Exception as error:
            raise AssertionError(f"{block.place}: {type(error).__name__}: {error}") from error


def _run(block: Block, names: dict[str, object]) -> None:
    if block.language == "python":
        with contextlib.redirect_stdout(io.StringIO()):
            exec(compile(block.text, block.place, "exec", dont_inherit=True), names)
    # The README uses the reader's own recordings; its commands appear in full on the pages.
    commands = [] if block.page == README else block.commands
    for number, words in enumerate(commands):
        arguments, output = (words[:-2], words[-1]) if ">" in words else (words, "")
        with pytest.MonkeyPatch.context() as patch:
            # Pictures, reports and other processes take most of the time and are tested elsewhere.
            leave_out(patch, *(["draw"] if words[0] == "report" else ["draw", "report"]))
            patch.setattr("ospc.batch.work.on_this_machine", lambda tasks, processes: Pretending()(tasks))
            arguments = [*arguments, *FEWER_FRAMES.get(words[0], [])]
            printed = run_command(arguments, block.exit_codes if number == len(commands) - 1 else (0, 3))
        if output:
            Path(output).write_text(printed, encoding="utf-8")


def every_block() -> list[Block]:
    return [block for page in [*pages(), README] for block in blocks(page)]


def resolved(words: list[str]) -> tuple[str, click.Command]:
    """Return the full name of the command that the words call, and the command."""
    command: click.Command = cli
    context = click.Context(cli, info_name="ospc")
    for word in words:
        inner = command.get_command(context, word) if isinstance(command, click.Group) else None
        if inner is None:
            break
        command, context = inner, click.Context(inner, info_name=word, parent=context)
    return context.command_path, command


@pytest.mark.parametrize("block", [b for b in every_block() if b.commands], ids=lambda block: block.place)
def test_commands_and_options_exist(block: Block) -> None:
    """This includes blocks that are not run."""
    for words in block.commands:
        name, command = resolved(words)
        options = {option for parameter in command.params for option in parameter.opts} | {
            "--help",
            "-h",
            "--version",
        }
        unknown = {word.partition("=")[0] for word in words if re.match(r"--?[a-z]", word)} - options
        assert not unknown, f"{block.place}: {name} has no option {unknown}"


def test_every_command_is_shown_on_a_page() -> None:
    """The list of all commands does not count."""
    shown = {words[0] for block in every_block() for words in block.commands if words}
    assert set(cli.list_commands(click.Context(cli))) - shown == set()


def test_blocks_that_are_not_run_give_a_reason() -> None:
    assert [b.place for b in every_block() if b.not_run and len(b.not_run) < 5] == []


def test_every_page_can_be_reached_from_the_index() -> None:
    reached, todo = set(), [DOCS / "index.md"]
    while todo:
        page = todo.pop()
        if page in reached:
            continue
        reached.add(page)
        text = page.read_text(encoding="utf-8")
        for block in text.split("```{toctree}")[1:]:
            for line in block.split("```")[0].splitlines():
                entry = line.strip()
                if entry and not entry.startswith(":"):
                    target = entry.split("<")[-1].rstrip(">")
                    todo += list(page.parent.glob(f"{target}.md"))
    assert set(pages()) - reached == set()


def test_the_links_of_the_readme_exist() -> None:
    """Links on other pages are checked when the site is built."""
    links = [link for link in re.findall(r"\]\(([^)]+)\)", README.read_text(encoding="utf-8")) if ":" not in link]
    assert links
    assert [link for link in links if not (ROOT / link).exists()] == []

"""The documents tell the truth: commands and code in them run, the tutorial shows what comes,
generated files are what programs write.
"""

import ast
import re
import shlex
import subprocess
import sys
import tomllib

import pytest
from code_blocks import DOCUMENTS, ROOT, block, blocks, blocks_in, commands
from command_line import line_with, python, summary_of
from command_line import orchard as run_py
from local_runs import local_hash
from patience import PATIENCE

import orchard
from chaos.report import ENDURANCE_HEAD, HEAD, RECOVERY
from docs.generate import generated
from orchard.field.scenario import Scenario, parse
from orchard.launch.local_run import run as harvest_locally
from orchard.launch.options import HarvestOptions
from orchard.launch.request import RunRequest
from orchard.launch.supervisor import free_port

README = (ROOT / "README.md").read_text()
# Of all documents but the tutorial, which is done step by step.
BLOCKS = [
    block for document in DOCUMENTS if "tutorial" not in document for block in blocks_in(document)
]
# The programs of docs/extending.md, each with its docstring, None without one.
EXAMPLES = {
    block.text: ast.get_docstring(ast.parse(block.text))
    for block in blocks_in("docs/extending.md")
    if block.language == "python"
}
# A program with a docstring is a file of examples/seams. The others are run.
FILES = {text: words for text, words in EXAMPLES.items() if words}
PROGRAMS = [
    block.text
    for block in BLOCKS
    if (block.language, block.name) == ("python", "") and block.text not in FILES
]
COMMANDS = [
    line
    for block in BLOCKS
    if (block.language, block.name) == ("sh", "")
    for line in block.text.splitlines()
]
# Blocks that .ci/run does with the clone and the wheel that it has.
INSTALLING = ("clone", "activate", "package", "notebook")
# Keys of a summary that only runs with a recording, forks, and runs in realtime have.
KEYS_OF_RECORDED = ("recording_parts", "recording_gaps", "messages_dropped")
KEYS_OF_REALTIME = ("ticks_late", "velocities_missed", "answer_milliseconds")
KEYS_OF_SOME_RUNS = (*KEYS_OF_RECORDED, "forked_from", *KEYS_OF_REALTIME)


# Simulated s after which harvests of documents are ended here.
BRIEF = "5"


@pytest.mark.parametrize("code", PROGRAMS, ids=range(len(PROGRAMS)))
def test_the_programs_in_the_documents_run(code, tmp_path):
    assert python("-c", code, ORCHARD_RUNS=str(tmp_path)).stdout


def test_the_examples_in_extending_md_are_the_files():
    shown = {}
    for text, words in FILES.items():
        (module,) = set(re.findall(r"examples\.seams\.(\w+)\.", words))
        shown[f"{module}.py"] = text
    assert shown == {
        path.name: path.read_text() for path in (ROOT / "examples" / "seams").glob("*.py")
    }
    assert all(len(text.splitlines()) <= 30 for text in shown.values())


@pytest.mark.parametrize("command", COMMANDS)
def test_the_commands_in_the_documents_run(command, tmp_path):
    """Commands of `make` and `python` only say what they would do, because they would take long.

    The others run in this environment.
    """
    program, *words = shlex.split(command, comments=True)
    if program == "orchard":
        record = [] if "--record" in words else ["--record", "run.rrd"]
        # The last duration counts. Without it the command would only take longer.
        words += ["--duration", BRIEF]
        assert run_py(*words, *record, folder=tmp_path).stdout
        return
    quick = {
        "make": ["make", "--dry-run", *words],
        "python": [sys.executable, *words, "--help"],
    }
    line = quick[program]
    done = subprocess.run(line, cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 0, done.stdout + done.stderr


def test_each_block_with_a_name_has_a_test_that_names_it():
    tests = "".join(
        path.read_text()
        for folder in ("tests", "bridges", "ecosystem")
        for path in (ROOT / folder).rglob("test_*.py")
    )
    named = [block.name for block in BLOCKS if block.name and block.name not in INSTALLING]
    assert [name for name in named if f'"{name}"' not in tests] == []


def test_the_scenario_in_the_documents_is_one():
    assert parse(block("docs/reference.md", "scenario")).rows == 8


def test_the_reference_of_the_library_has_all_names():
    shown = re.findall(r"^### `orchard\.(\w+)", (ROOT / "docs" / "api.md").read_text(), re.M)
    assert sorted(name for name in shown if name in dir(orchard)) == sorted(orchard.__all__)


def test_the_reference_of_the_library_reads_in_a_clone():
    """Each name has words of its own, and there are no directives that only a program reads."""
    text = (ROOT / "docs" / "api.md").read_text()
    sections = [section.splitlines()[1:] for section in text.split("\n### ")[1:]]
    assert "eval-rst" not in text
    assert ".. auto" not in text
    assert [section for section in sections if not any(line.strip() for line in section)] == []


def test_the_library_reference_says_arguments_and_errors():
    """What the source says of arguments stands in the reference, with the quotes of texts."""
    text = (ROOT / "docs" / "api.md").read_text()
    sections = {section.split("(")[0].strip("`"): section for section in text.split("\n### ")}
    assert "`check_agents`: check that" in sections["orchard.Local"]
    assert "Raises TypeError for what is no scenario" in sections["orchard.gym.HarvestEnv"]
    assert "prefix: str = 'orchard'" in sections["orchard.connect"]
    assert "No(reason: str)" in sections["orchard.No"]
    fields = [line for line in sections["orchard.Action"].splitlines() if line.startswith("- ")]
    assert [line for line in fields if "`: " not in line] == [], "these fields say nothing"
    assert len(fields) == len(orchard.Action.__struct_fields__)


def test_the_summarys_document_has_all_its_keys(tmp_path):
    """The keys are those of a local run, and those that a recording, a fork or realtime adds."""
    request = RunRequest(
        HarvestOptions(mode="local", duration=0.5), Scenario(rows=3), None, tmp_path
    )
    summary, _ = harvest_locally(request, None, lambda *_: None)
    section = (
        (ROOT / "docs" / "reference.md")
        .read_text()
        .split("\n## The summary\n")[1]
        .split("\n## ")[0]
    )
    table = [line.split(" | ")[0] for line in section.splitlines() if line.startswith("| `")]
    assert sorted(key for line in table for key in re.findall(r"`(\w+)`", line)) == sorted(
        [*summary, *KEYS_OF_SOME_RUNS]
    )


def test_the_readmes_speeds_are_those_of_the_benchmarks():
    (said,) = re.findall(
        r"its core makes ([\d,]+) steps a second, where IR-SIM makes ([\d.]+) and Stage, as quoted,"
        r" ([\d.]+)",
        README,
    )
    rows = [
        line.strip("|* ").replace("*", "").split(" | ")
        for line in (ROOT / "bench" / "results.md").read_text().splitlines()
    ]
    # The third cell is the rate with 30 robots.
    rates = {row[0]: row[2].strip() for row in rows if len(row) == 6}
    assert said == (rates["our core"], rates["ir-sim 2.12.0"], rates["Stage 4.3 at 0.1 m, quoted"])


def test_the_soak_results_have_the_words_of_their_program():
    text = (ROOT / "chaos" / "results.md").read_text()
    assert RECOVERY in text
    assert all(f"| {' | '.join(head)} |" in text for head in (HEAD, ENDURANCE_HEAD))


def test_the_files_that_the_readme_names_exist():
    for name in re.findall(r"\]\(([^)#]+)\)", README):
        assert (ROOT / name).exists(), name


def test_the_generated_files_are_what_the_code_says():
    for name, text in generated().items():
        assert (ROOT / name).read_text() == text, f"{name} is stale: make docs"


def test_the_documents_are_few_and_each_says_for_whom_it_is():
    pages = {path.name: path.read_text() for path in (ROOT / "docs").glob("*.md")}
    assert len(pages) <= 18
    index = pages["index.md"]
    assert [
        f":caption: {kind}" in index for kind in ("Tutorial", "How-to", "Explanation", "Reference")
    ] == [True] * 4
    assert [
        name for name in pages if not re.search(rf"^({name[:-3]}|# Orchard)$", index, re.M)
    ] == []
    for name, text in pages.items():
        first = re.sub(r"^<!--.*?-->\n", "", text, flags=re.S).split("\n\n")[1]
        assert first.startswith("For ") and "After this page you" in first, (
            f"{name} does not say for whom it is"
        )
        assert "do not edit" not in re.sub(r"<!--.*?-->", "", text, flags=re.S), name


@pytest.mark.parametrize("document", DOCUMENTS)
def test_the_cells_of_tables_are_short(document):
    lines = [line for line in (ROOT / document).read_text().splitlines() if line.startswith("|")]
    assert [
        cell for line in lines for cell in line.strip("| ").split(" | ") if len(cell.split()) > 30
    ] == []


def test_the_changelog_has_one_change_an_entry():
    text = (ROOT / "CHANGELOG.md").read_text()
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert f"\n## {version}" in text
    newest = text.partition("\n## Next")[2].partition("\n## ")[0]
    lines = [line for line in newest.splitlines() if line]
    headings = [line for line in lines if line.startswith("#")]
    entries = [line for line in lines if not line.startswith("#")]
    assert headings == ["### Added", "### Changed", "### Fixed"]
    assert [entry for entry in entries if not entry.startswith("- ") or len(entry) > 140] == []


def test_the_map_of_the_code_names_every_package():
    text = (ROOT / "CONTRIBUTING.md").read_text()
    packages = {
        path.parent.relative_to(ROOT).as_posix() for path in ROOT.glob("orchard/**/__init__.py")
    } - {"orchard"}
    assert [package for package in [*packages, "processes"] if f"`{package}/`" not in text] == []


def test_each_package_says_what_it_holds():
    for path in ROOT.glob("orchard/**/__init__.py"):
        assert ast.get_docstring(ast.parse(path.read_text())), path


def test_every_dependency_has_a_reason():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted = [
        *project["dependencies"],
        *(line for extra in project["optional-dependencies"].values() for line in extra),
    ]
    table = (ROOT / "CONTRIBUTING.md").read_text().split("## Dependencies, and why")[1]
    named = {
        name
        for line in table.splitlines()
        if line.startswith("| ")
        for name in line.split("|")[1].strip().split(", ")
    }
    assert {re.split(r"[=<>\[]", line)[0] for line in wanted} <= named


TUTORIAL = (ROOT / "docs" / "tutorial.md").read_text()
STEPS = {step.splitlines()[0]: blocks(step) for step in TUTORIAL.split("\n## ")[1:]}


def run_in(folder, command):
    """Run a command in a folder. Return what it prints."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.parametrize("step", [step for step in STEPS if "machine" not in step])
def test_a_step_of_the_tutorial(step, tmp_path):
    """Its blocks are done in their order: a block with a name is a file, one of text is the output
    of the program before it.
    """
    output = ""
    for part in STEPS[step]:
        if part.name:
            (tmp_path / part.name).write_text(part.text)
        elif part.language == "python":
            output = run_in(tmp_path, [sys.executable, "-c", part.text])
        elif part.language == "text":
            assert output == part.text, "the tutorial shows another output"
        else:
            for command in commands(part.text):
                run_in(
                    tmp_path,
                    [
                        *command,
                        "--duration",
                        BRIEF,
                        *([] if "--record" in command else ["--record", "run.rrd"]),
                    ],
                )


def test_the_two_terminals_of_the_tutorial(tmp_path):
    """The first command leaves the carriers to the second one, and waits for it. Together they have
    the hash of local mode.
    """
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    terminals = [block("docs/tutorial.md", f"{number} terminal") for number in ("first", "second")]
    (first,), (second,) = (
        commands(text.replace("tcp/127.0.0.1:7447", endpoint)) for text in terminals
    )
    first += ["--duration", "10", "--record", "none", "--summary", str(tmp_path / "summary.json")]
    with subprocess.Popen(
        first, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as one:
        try:
            line_with("carrier: left to other processes", one)
            run_in(tmp_path, second)
            one.communicate(timeout=PATIENCE)
        finally:
            one.kill()
    # 10 s are 100 ticks.
    assert summary_of(tmp_path / "summary.json")["hash"] == local_hash(Scenario(rows=3), 100)

"""Asks the package registry for known vulnerabilities of packages, by pip-audit.

Fails if it names one.

An answer counts only if the registry also reports what a vulnerable package has: pip-audit finds
"No known vulnerabilities" too where the registry answers nothing. Else it says "NOT CHECKED", and
fails nothing. Arguments: the program pip-audit; a file of `name==version` lines.
"""

import json
import subprocess
import sys
from pathlib import Path
from tempfile import NamedTemporaryFile

VULNERABLE = "pycrypto==2.6.1"  # CVE-2013-7459, of which no version is free
HARMLESS: dict[str, str] = {}  # vulnerabilities that do us no harm -> why


def ask(audit: str, packages: str) -> tuple[dict[str, list[str]], dict[str, str]]:
    """Return the vulnerabilities of each package that was checked, and for each other one why it
    was not.
    """
    with NamedTemporaryFile("w", suffix=".txt") as file:
        file.write(packages)
        file.flush()
        options = [
            "--no-deps",
            "--disable-pip",
            "--format",
            "json",
            "--progress-spinner",
            "off",
            "--requirement",
            file.name,
        ]
        said = subprocess.run([audit, *options], capture_output=True, text=True, check=False)
    try:
        answers = json.loads(said.stdout)["dependencies"]
    except json.JSONDecodeError:
        return {}, {"any package": (said.stderr.splitlines() or ["pip-audit said nothing"])[-1]}
    found = {
        answer["name"]: [vulnerability["id"] for vulnerability in answer["vulns"]]
        for answer in answers
        if "vulns" in answer
    }
    return found, {
        answer["name"]: answer["skip_reason"] for answer in answers if "skip_reason" in answer
    }


def main(audit: str, file: str) -> int:
    """Print what is known, and return the exit code."""
    known, unchecked = ask(audit, VULNERABLE)
    if not any(known.values()):
        why = next(iter(unchecked.values()), "it knows of none")
        print(
            f"vulnerabilities: NOT CHECKED, for the registry reports none of {VULNERABLE}, which"
            f" has some: {why}"
        )
        return 0
    found, unchecked = ask(audit, Path(file).read_text())
    harmful = {
        name: ids
        for name, all_ids in found.items()
        if (ids := [each for each in all_ids if each not in HARMLESS])
    }
    print(
        f"vulnerabilities: known of {len(harmful)} of the {len(found)} packages that were checked"
    )
    for name, ids in harmful.items():
        print(
            f"  {name}: {', '.join(ids)}: take a version without them, or say in HARMLESS of"
            " .ci/vulnerabilities.py why they do no harm"
        )
    for name, why in unchecked.items():
        print(f"  {name}: NOT CHECKED: {why}")
    return 1 if harmful else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))

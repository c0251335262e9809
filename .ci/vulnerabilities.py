"""Asks the package registry for known vulnerabilities of packages, by pip-audit.

    python .ci/vulnerabilities.py PIP-AUDIT FILE      FILE has lines of name==version

Fails if the registry names one. pip-audit finds "No known vulnerabilities" also where the registry
answers nothing. So a package with a known vulnerability is asked for first: if the registry reports
none of it, this says "NOT CHECKED", and fails nothing.
"""

import json
import subprocess
import sys
from pathlib import Path
from tempfile import NamedTemporaryFile

VULNERABLE = "pycrypto==2.6.1"  # CVE-2013-7459, of which no version is free
HARMLESS: dict[str, str] = {}  # vulnerabilities that do us no harm -> why


def ask(audit: str, packages: str) -> tuple[dict[str, list[str]], dict[str, str]]:
    """Return the vulnerabilities of each package that was checked, and for each other package why
    it was not.
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
        process = subprocess.run([audit, *options], capture_output=True, text=True, check=False)
    try:
        answers = json.loads(process.stdout)["dependencies"]
    except json.JSONDecodeError:
        *_, why = ["pip-audit said nothing", *process.stderr.splitlines()]
        return {}, {"any package": why}
    checked = {}
    unchecked = {}
    for answer in answers:
        if "vulns" in answer:
            checked[answer["name"]] = [vulnerability["id"] for vulnerability in answer["vulns"]]
        if "skip_reason" in answer:
            unchecked[answer["name"]] = answer["skip_reason"]
    return checked, unchecked


def main(audit: str, file: str) -> int:
    """Print what is known, and return the exit code."""
    known, unchecked = ask(audit, VULNERABLE)
    if not any(known.values()):
        *_, why = ["it knows of none", *unchecked.values()]
        print(
            f"vulnerabilities: NOT CHECKED, for the registry reports none of {VULNERABLE}, which"
            f" has some: {why}"
        )
        return 0
    checked, unchecked = ask(audit, Path(file).read_text())
    harmful = {}
    for name, all_ids in checked.items():
        ids = [each for each in all_ids if each not in HARMLESS]
        if ids:
            harmful[name] = ids
    print(
        f"vulnerabilities: known of {len(harmful)} of the {len(checked)} packages that were checked"
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

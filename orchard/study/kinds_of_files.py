"""The kinds of files that a study and a benchmark write beside their summary.

A file that is there already is replaced only if its begin shows that it is of the same kind.
"""

from orchard.terminal.files import KindOfFile

# The maker of a picture or a report, as its metadata name it.
MAKER = "Orchard"
# The begin of a table: of a study, of a study with --sensitivity, and of a study that was stopped
# before its first run, which has columns without names.
_HEADS = (rb"[^\n]*,bound_bins_per_hour,bottleneck,", rb"moved,low,high,at_low,", rb"\r\n\Z")
TABLE = KindOfFile("the table of a study", b"|".join(_HEADS))
REPORT = KindOfFile("the report of a study", rb'.*<meta name="generator" content="Orchard">')
SUBMISSION = KindOfFile(
    "a submission to the benchmark",
    rb'\{\n  "set": [^\n]*\n  "policy": [^\n]*\n  "policy_version": ',
)
# A PNG, or an SVG.
PICTURE = KindOfFile(
    "a picture", rb"\x89PNG.*Software\0Orchard|<\?xml .*<dc:title>Orchard</dc:title>"
)

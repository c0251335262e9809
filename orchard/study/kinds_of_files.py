"""The kinds of files that a study writes beside its summary. Only such files are replaced."""

from orchard.terminal.files import KindOfFile

# Who has made a picture or a report, as its metadata say.
MAKER = "Orchard"
# A study that was stopped before its first run has written an empty head.
_HEADS = (rb"[^\n]*,bound_bins_per_hour,bottleneck,", rb"moved,low,high,at_low,", rb"\r\n\Z")
TABLE = KindOfFile("the table of a study", b"|".join(_HEADS))
REPORT = KindOfFile("the report of a study", rb'.*<meta name="generator" content="Orchard">')
# PNG, and SVG.
SUBMISSION = KindOfFile(
    "a submission to the benchmark",
    rb'\{\n  "set": [^\n]*\n  "policy": [^\n]*\n  "policy_version": ',
)
PICTURE = KindOfFile(
    "a picture", rb"\x89PNG.*Software\0Orchard|<\?xml .*<dc:title>Orchard</dc:title>"
)

"""The kinds of files that a study writes beside its summary. Only such files are replaced."""

from orchard.terminal.files import KindOfFile

# Who has made a picture or a report, as its metadata say.
MAKER = "Orchard"
# A study that was stopped before its first run has written an empty head.
TABLE = KindOfFile("the table of a study", rb"[^\n]*,bound_bins_per_hour,bottleneck,|\r\n\Z")
REPORT = KindOfFile("the report of a study", rb'.*<meta name="generator" content="Orchard">')
# PNG, and SVG.
PICTURE = KindOfFile(
    "a picture", rb"\x89PNG.*Software\0Orchard|<\?xml .*<dc:title>Orchard</dc:title>"
)

"""Control pictures made from annotated photographs, by moving cut-outs along a flat road.

An object is cut out, the hole is filled with the road itself, and copies are put where a rule needs
them. What an edit may be trusted with is less than what a renderer or a stage gives.
"""

from eyechart.edits.annotations import BOXES, Annotations, ObjectBox, Photo, read_annotations
from eyechart.edits.checks import EditLimits
from eyechart.edits.controls import PICTURES, Moves
from eyechart.edits.edit import METHOD, RECORD, TABLE, EditResult, EditSource, edit_photographs, import_command
from eyechart.edits.formats import ANNOTATION_FORMATS, annotations_of, read_format
from eyechart.edits.masks import CUTS, usual_cut

__all__ = [
    "ANNOTATION_FORMATS",
    "BOXES",
    "CUTS",
    "METHOD",
    "PICTURES",
    "RECORD",
    "TABLE",
    "Annotations",
    "EditLimits",
    "EditResult",
    "EditSource",
    "Moves",
    "ObjectBox",
    "Photo",
    "annotations_of",
    "edit_photographs",
    "import_command",
    "read_annotations",
    "read_format",
    "usual_cut",
]

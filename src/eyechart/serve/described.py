"""The server described for a program: its OpenAPI document."""

from eyechart import __version__
from eyechart.serve.limits import ServerLimits
from eyechart.studies.guardian import VIEWS

TYPES = ("image/png", "image/jpeg", "image/webp", "application/octet-stream")
"""What a picture may be sent as; what it is, its bytes say."""


def openapi(limits: ServerLimits, deadline_s: float) -> dict[str, object]:
    """Return the OpenAPI document of the server."""
    vote = {"type": ["boolean", "null"], "description": "true: hazard, false: clear, null: missing"}
    votes = {"type": "object", "properties": dict.fromkeys(VIEWS, vote)}
    assessment = {
        "type": "object",
        "required": ["answer", "votes", "missing", "latency_s", "why"],
        "properties": {
            "answer": {"type": "string", "enum": ["hazard", "clear", "abstain"]},
            "votes": {"type": "object", "additionalProperties": votes},
            "missing": {"type": "object", "additionalProperties": {"type": "string"}},
            "latency_s": {"type": "number", "description": "seconds from when the guardian was asked to its answer"},
            "why": {"type": "string"},
        },
    }
    error = {"type": "object", "required": ["error"], "properties": {"error": {"type": "string"}}}

    def said(words: str, schema: object) -> dict[str, object]:
        return {"description": words, "content": {"application/json": {"schema": schema}}}

    refusals = {
        "400": "the body is empty, or the request cannot be understood",
        "403": "another site's page asks",
        "408": f"the picture was not here within {deadline_s:g} s",
        "413": f"the picture has more than {limits.most_bytes} bytes",
        "415": "the body is sent as no picture, or without a Content-Type",
        "421": "the Host is none of the server's names",
        "422": f"the body is no picture that a bank would take, or one of more than {limits.most_pixels} pixels",
        "500": "an error inside the server",
    }
    full = said("too much to do, or the server is ending; ask again after Retry-After seconds", error)
    full["headers"] = {"Retry-After": {"schema": {"type": "integer"}, "description": "seconds"}}
    picture = {"schema": {"type": "string", "format": "binary"}}
    post = {
        "summary": f"What the committee says of a picture, within {deadline_s:g} s",
        "requestBody": {"required": True, "content": dict.fromkeys(TYPES, picture)},
        "responses": {
            "200": said("hazard, clear, or abstain; missing votes never count as clear", assessment),
            **{status: said(words, error) for status, words in refusals.items()},
            "503": full,
        },
    }

    def get(words: str, kind: str = "application/json") -> dict[str, object]:
        return {"get": {"summary": words, "responses": {"200": {"description": words, "content": {kind: {}}}}}}

    return {
        "openapi": "3.1.0",
        "info": {"title": "eyechart guardian", "version": __version__},
        "paths": {
            "/assess": {"post": post},
            "/health": get("that the server is there, with which guardian, and the seconds since each model voted"),
            "/metrics": get("metrics as Prometheus reads them", "text/plain"),
            "/openapi.json": get("this document"),
        },
    }

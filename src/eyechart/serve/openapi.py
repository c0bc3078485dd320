"""The OpenAPI document of a served guardian."""

from eyechart import __version__
from eyechart.serve.limits import TYPES, ServerLimits
from eyechart.studies.guardian import VIEWS


def openapi(limits: ServerLimits, deadline_s: float) -> dict[str, object]:
    """Return the OpenAPI document of the server."""
    vote = {"type": ["boolean", "null"], "description": "true: hazard, false: clear, null: missing"}
    assessment = {
        "type": "object",
        "required": ["answer", "votes", "missing", "latency_s", "why"],
        "properties": {
            "answer": {"type": "string", "enum": ["hazard", "clear", "abstain"]},
            "votes": {
                "type": "object",
                "additionalProperties": {"type": "object", "properties": dict.fromkeys(VIEWS, vote)},
            },
            "missing": {"type": "object", "additionalProperties": {"type": "string"}},
            "latency_s": {"type": "number", "description": "seconds from when the guardian was asked to its answer"},
            "why": {"type": "string"},
        },
    }
    error = {"type": "object", "required": ["error"], "properties": {"error": {"type": "string"}}}

    def said(words: str, schema: object) -> dict[str, object]:
        return {"description": words, "content": {"application/json": {"schema": schema}}}

    refusals = {
        "400": "the body is empty",
        "408": f"the picture was not here within {deadline_s:g} s",
        "413": f"the picture has more than {limits.most_bytes} bytes",
        "415": "the body is sent as no picture",
        "422": f"the body is no picture that can be shown, or one of more than {limits.most_pixels} pixels",
        "500": "an error inside the server",
    }
    full = said("too much to do; ask again after Retry-After seconds", error)
    full["headers"] = {"Retry-After": {"schema": {"type": "integer"}, "description": "seconds"}}
    post = {
        "summary": f"What the committee says of a picture, within {deadline_s:g} s",
        "requestBody": {
            "required": True,
            "content": {kind: {"schema": {"type": "string", "format": "binary"}} for kind in TYPES},
        },
        "responses": {
            "200": said("hazard, clear, or abstain; missing votes never count as clear", assessment),
            **{status: said(words, error) for status, words in refusals.items()},
            "503": full,
        },
    }

    def get(words: str, kind: str) -> dict[str, object]:
        return {"get": {"summary": words, "responses": {"200": {"description": words, "content": {kind: {}}}}}}

    return {
        "openapi": "3.1.0",
        "info": {"title": "eyechart guardian", "version": __version__},
        "paths": {
            "/assess": {"post": post},
            "/health": get(
                "that the server is there, with which guardian, and the seconds since each model voted",
                "application/json",
            ),
            "/metrics": get("metrics as Prometheus reads them", "text/plain"),
            "/openapi.json": get("this document", "application/json"),
        },
    }

"""The OpenAPI document of the server."""

from eyechart import __version__
from eyechart.serve.limits import ServerLimits
from eyechart.studies.guardian import VIEWS

TYPES = ("image/png", "image/jpeg", "image/webp", "application/octet-stream")
"""The content types of a picture; its bytes decide the real format."""


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
            "latency_s": {"type": "number", "description": "seconds from the guardian's call to its answer"},
            "why": {"type": "string"},
        },
    }
    error = {"type": "object", "required": ["error"], "properties": {"error": {"type": "string"}}}

    def said(words: str, schema: object) -> dict[str, object]:
        return {"description": words, "content": {"application/json": {"schema": schema}}}

    refusals = {
        "400": "the body is empty, or the request is malformed",
        "403": "the request comes from another site's page",
        "408": f"the picture did not arrive within {deadline_s:g} s",
        "413": f"the picture has more than {limits.most_bytes} bytes",
        "415": "the Content-Type is none of a picture, or is missing",
        "421": "the Host is none of the server's names",
        "422": f"the body is no picture that a bank would take, or one of more than {limits.most_pixels} pixels",
        "500": "an error inside the server",
    }
    full = said("the server is full or ending; try again after Retry-After seconds", error)
    full["headers"] = {"Retry-After": {"schema": {"type": "integer"}, "description": "seconds"}}
    picture = {"schema": {"type": "string", "format": "binary"}}
    post = {
        "summary": f"The committee's answer to a picture, within {deadline_s:g} s",
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
            "/health": get("the server's status, its guardian, and the seconds since each model voted"),
            "/metrics": get("metrics in the format of Prometheus", "text/plain"),
            "/openapi.json": get("this document"),
        },
    }

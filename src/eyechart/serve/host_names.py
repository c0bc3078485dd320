"""The names that a server answers to, and the protection from pages of other sites.

A web page can reach a server on its reader's machine: by a name of its own that resolves there (DNS
rebinding), or from another origin. The Host and the browser's own headers reveal that.
"""

import ipaddress
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from urllib.parse import urlsplit

from aiohttp import hdrs
from multidict import CIMultiDictProxy

from eyechart.errors import GuardianError

_HOST = re.compile(r"(?P<name>\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9_.-]+)(?::(?P<port>\d{1,5}))?")
_PORTS = {"http": 80, "https": 443}
_OWN = {"same-origin", "none"}
"""Values of Sec-Fetch-Site for a request that no other site made."""


def require_name(name: str) -> str:
    """Return a name in small letters; raises GuardianError where no Host header could hold it."""
    match = _HOST.fullmatch(name)
    if match is None or match["port"] is not None:
        raise GuardianError(f"'{name[:80]}' is no name of a host: give it as in cam.example or [::1], without a port")
    return _plain(match["name"])


@dataclass(frozen=True, slots=True)
class HostNames:
    """The names that a server answers to.

    ``given`` are those of its operator. A server on ``loopback`` answers to them and to this
    machine's own names. Any other server answers to them alone, or to any name if none is given.
    """

    given: frozenset[str] = frozenset()
    loopback: bool = True

    @classmethod
    def of(cls, given: Sequence[str], addresses: Sequence[str]) -> "HostNames":
        """Return the names of a server that listens at these numeric addresses."""
        return cls(frozenset(map(require_name, given)), all(_is_loopback(address) for address in addresses))

    def refuses(self, headers: CIMultiDictProxy[str]) -> str | None:
        """Return why a request with these headers is not for this server; None if it is."""
        hosts = headers.getall(hdrs.HOST, [])
        found = _HOST.fullmatch(hosts[0]) if len(hosts) == 1 else None
        if found is None:
            return "the Host must be given once, as a name with or without a port"
        name = _plain(found["name"])
        if name in self.given or (not self.given and not self.loopback):
            return None
        if self.loopback and (name == "localhost" or _is_loopback(name)):
            return None
        return f"the Host '{name[:80]}' is none of this server's names; another is allowed with --allow-host"


def crosses(headers: Mapping[str, str]) -> bool:
    """Return whether a browser's headers say that another site's page made the request."""
    if headers.get("Sec-Fetch-Site", "none") not in _OWN:
        return True
    origin = headers.get(hdrs.ORIGIN)
    if origin is None:
        return False
    own = f"{origin.partition('://')[0]}://{headers[hdrs.HOST]}"
    try:
        return _authority(origin) != _authority(own)
    except (ValueError, KeyError):  # "null", or no address
        return True


def _authority(url: str) -> tuple[str, int]:
    """Return the host and port of an address; raises ValueError or KeyError if it is malformed."""
    parts = urlsplit(url)
    return _plain(parts.hostname or ""), parts.port or _PORTS[parts.scheme]


def _plain(name: str) -> str:
    return name.strip("[]").rstrip(".").lower()


def _is_loopback(name: str) -> bool:
    try:
        return ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False

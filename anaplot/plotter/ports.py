"""Which port each link of an instrument is on, as a person says it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from anaplot.errors import InputError
from anaplot.plotter.schema import Profile
from anaplot.textfiles.wording import hint, plain, quoted

__all__ = ["UNCHECKED", "addresses_of", "parse_ports"]

UNCHECKED = "parity is not checked by this line"
"""What the operator is told of a profile with a parity on a port without."""


def parse_ports(profile: Profile, texts: Iterable[str]) -> dict[str, str]:
    """Read port addresses as a person types them.

    Parameters
    ----------
    profile
        Whose links they are.
    texts
        One address for a profile with one link, else ``LINK=ADDRESS`` for each, also parted by
        commas.

    Returns
    -------
    dict of str to str
        Link -> address.

    Raises
    ------
    InputError
        When a link is unknown, missing or given twice.
    """
    items = list(texts)
    if len(profile.links) == 1 and len(items) == 1:
        address = items[0]
        head = f"{profile.default_link}="
        return {profile.default_link: address.removeprefix(head)}
    found: dict[str, str] = {}
    for item in (part for text in items for part in text.split(",")):
        name, equals, address = item.partition("=")
        if not equals or not address:
            raise InputError(
                f'"{plain(item, 60)}": {profile.id} needs LINK=PORT for each of its links '
                f"({', '.join(profile.links)})"
            )
        if name not in profile.links:
            near = hint(name, profile.links)
            raise InputError(f"{profile.id} has no link {quoted(name)}{near}")
        if name in found:
            raise InputError(f'{profile.id}: link "{name}" is given twice')
        found[name] = address
    return addresses_of(profile, found)


def addresses_of(profile: Profile, ports: Mapping[str, str] | str) -> dict[str, str]:
    """Return the address of every link of the profile."""
    if isinstance(ports, str):
        if len(profile.links) > 1:
            names = ", ".join(profile.links)
            raise InputError(f"{profile.id} needs a port for each of its links: {names}")
        return {profile.default_link: ports}
    for name in ports:
        if name not in profile.links:
            known = ", ".join(profile.links)
            raise InputError(f'{profile.id} has no link "{plain(name, 40)}" (known: {known})')
    for name in profile.links:
        if name not in ports:
            raise InputError(f'{profile.id}: no port is given for its link "{name}"')
    return {name: ports[name] for name in profile.links}

"""What a host sends to a device: requests for a position, and commands to its drive."""

from __future__ import annotations

from anaplot.errors import InputError
from anaplot.plotter.origin import Origin
from anaplot.plotter.readings import Position
from anaplot.plotter.schema import DriveFormat, Profile

__all__ = ["drive_command", "poll_request", "stop_command"]


def poll_request(profile: Profile) -> bytes:
    """Return the bytes that ask for a position.

    Raises
    ------
    InputError
        The device speaks by itself.
    """
    if profile.poll is None:
        raise InputError(f"{profile.id} cannot be asked: it speaks by itself")
    return profile.poll.request


def drive_command(profile: Profile, origin: Origin, position: Position) -> bytes:
    """Return the bytes that drive the plates: command with checksum and terminator.

    Parameters
    ----------
    profile
        The device.
    origin
        Of its counters.
    position
        Target [mm], plate coordinates; of a mono comparator xl, yl count.

    Raises
    ------
    InputError
        There is no drive, the origin is lost, or the target is outside the limits.
    """
    drive = profile.drive
    if drive is None:
        raise InputError(f"{profile.id} has no drive: move the plates by hand")
    values: dict[str, float] = {}
    axes = origin.to_axes(position)
    for (name, axis), value in zip(profile.axes.items(), axes, strict=True):
        low, high = drive.limits[name]
        if not low <= value <= high:
            raise InputError(
                f"axis {name} cannot be driven to {value:.3f} mm: "
                f"its limits are {low:g} and {high:g} mm"
            )
        values[name] = value * axis.direction / axis.scale
    return _sent(profile, drive, drive.command.render(values))


def stop_command(profile: Profile) -> bytes:
    """Return the bytes that stop a drive.

    Raises
    ------
    InputError
        There is no drive.
    """
    if profile.drive is None:
        raise InputError(f"{profile.id} has no drive: there is nothing to stop")
    return _sent(profile, profile.drive, profile.drive.stop.render({}))


def _sent(profile: Profile, drive: DriveFormat, payload: bytes) -> bytes:
    checksum = profile.checksum
    if checksum is not None and checksum.host:
        payload += checksum.digits(payload)
    return payload + drive.terminator

"""`bus bridge ENGINE install` and `uninstall`: a systemd unit that runs the bridge with the given options."""

import pwd
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

from bus.process.address import domain_id
from bus_cli.output import CommandError, print_json, say
from bus_cli.units import quoted, remove, systemctl, unit_folder, write

__all__ = ["add_service_arguments", "change_service", "option", "words_of"]

_OURS: Final = "# Written by bus bridge install."
_VERBS: Final = "install", "uninstall"
_TARGETS: Final = {False: "default.target", True: "multi-user.target"}


def add_service_arguments(parser: ArgumentParser) -> None:
    """Add the positional argument, and the options that belong to it."""
    # Without `choices`: the value of an option that argparse does not know would be called a wrong choice.
    parser.add_argument(
        "service",
        nargs="?",
        metavar="install|uninstall",
        help="write, or remove, a systemd unit that runs the bridge with these options; starts nothing",
    )
    group = parser.add_argument_group("with install and uninstall")
    group.add_argument("--system", action="store_true", help="for the machine instead of the current user")
    group.add_argument("--user", metavar="NAME", help="with --system: the user that runs the bridge")
    group.add_argument("--dry-run", action="store_true", help="print the file, and write nothing")


def option(key: str) -> str:
    """The option of the command line for a key of the configuration."""
    return f"--{key.removesuffix('s').replace('_', '-')}"


def change_service(args: Namespace, engine: str, words: Iterable[str]) -> int:
    """Write or remove the unit. `words`: the options of the bridge. Raises CommandError."""
    if args.service not in _VERBS:
        raise CommandError(f"{args.service!r} is neither {' nor '.join(_VERBS)}")
    is_system = _checked(args)
    domain = domain_id(args.domain)
    kind = _kind(args, engine)
    name = f"busd-bridge-{kind}{f'-{domain}' if domain else ''}.service"
    path = unit_folder(is_system=is_system) / name
    command = systemctl(is_system=is_system)
    if args.service == "uninstall":
        is_removed = remove(path, _OURS, _TARGETS[is_system])
        what_next = [f"{command} stop {name}", f"{command} daemon-reload"] if is_removed else []
        _report(args, [path] if is_removed else [], "Removed", what_next)
        return 0
    text = _text(engine, kind, domain, args.user or "", words)
    if args.dry_run:
        if args.json:
            print_json({"files": {str(path): text}})
        else:
            say(f"# {path}\n{text}", end="")
        return 0
    write(path, text)
    what_next = [f"{command} daemon-reload", f"{command} enable --now {name}"]
    if not (path.parent / f"{_busd(domain)}.socket").exists():
        what_next.insert(0, " ".join(["bus daemon install", *_scope(args), *_domain(domain)]))
    _report(args, [path], "Wrote", what_next)
    return 0


def _kind(args: Namespace, engine: str) -> str:
    """The bridge's part of the unit's name: a bus may have bridges to several domains of ROS 2."""
    kind = "rmw-zenoh" if getattr(args, "rmw", None) == "zenoh" else engine
    far_domain = getattr(args, "domain_id", None)
    return f"{kind}_{far_domain}" if far_domain else kind


def _busd(domain: int) -> str:
    """The name of busd's own units."""
    return f"busd-{domain}" if domain else "busd"


def _scope(args: Namespace) -> list[str]:
    return ["--system", "--user", args.user] if args.system else []


def _domain(domain: int) -> list[str]:
    return ["--domain", str(domain)] if domain else []


def words_of(flags: Mapping[str, Any]) -> list[str]:
    """The words of the command line for values by key; None: not given."""
    words: list[str] = []
    for key, value in flags.items():
        if isinstance(value, Mapping):  # files, and systemd starts the bridge in another folder
            words += words_of({name: Path(file).absolute() for name, file in value.items()})
        elif value is True:
            words.append(option(key))
        elif value not in (None, False):
            for one in value if isinstance(value, list | tuple) else (value,):
                words += [option(key), str(one)]
    return words


def _checked(args: Namespace) -> bool:
    """Whether it is for the machine. Raises CommandError for options that contradict."""
    if args.socket:
        raise CommandError("a unit's bus is chosen by --domain and --system, not by --socket")
    if not args.system:
        if args.user:
            raise CommandError("--user is for --system")
        return False
    if args.service == "uninstall":
        return True
    if not args.user:
        raise CommandError(
            "--system needs --user, the user that runs the bridge (not root: it needs no rights)"
        )
    try:
        pwd.getpwnam(args.user)
    except KeyError:
        raise CommandError(f"there is no user {args.user!r}") from None
    return True


def _text(engine: str, kind: str, domain: int, user: str, words: Iterable[str]) -> str:
    program = Path(sys.executable).with_name("bus")
    start = [str(program)] if program.is_file() else [sys.executable, "-m", "bus_cli"]
    command = " ".join(map(quoted, [*start, "bridge", engine, *words]))
    busd = _busd(domain)
    lines = [
        _OURS,
        "",
        "[Unit]",
        f"Description=Bridge of busd to {kind} (domain {domain})",
        f"Wants={busd}.socket",
        f"After={busd}.socket network-online.target",
        "StartLimitIntervalSec=0",
        "",
        "[Service]",
        f"ExecStart={command}",
        "# The bridge reads the rules of its file again.",
        "ExecReload=/bin/kill -HUP $MAINPID",
        "# The signal ends a bridge that has just begun to start.",
        "RestartForceExitStatus=SIGHUP",
        "# It ends if busd is away when it starts, and is started again.",
        "Restart=on-failure",
        "RestartSec=1",
        *([f"User={user}", f"Environment=BUSD_SOCKET=/run/busd/{domain}.sock"] if user else []),
        *([f"Environment=BUSD_DOMAIN={domain}"] if domain and not user else []),
        "Environment=BUSD_AUTOSTART=0",
        "NoNewPrivileges=yes",
        "LockPersonality=yes",
        "RestrictSUIDSGID=yes",
        "RestrictRealtime=yes",
        "SystemCallArchitectures=native",
        "UMask=0077",
        "",
        "[Install]",
        f"WantedBy={_TARGETS[bool(user)]}",
    ]
    return "\n".join(lines) + "\n"


def _report(args: Namespace, files: list[Path], done: str, what_next: list[str]) -> None:
    if args.json:
        print_json({"files": [str(path) for path in files], "next": what_next})
    elif files:
        for path in files:
            say(f"{done} {path}")
        say("Now type:", *what_next, sep="\n  ")
    else:
        say("No unit is installed")

"""Carries out the plan, brings quiet after each storm, and lets `judge` check the state then.

A complaint counts only if it stays for PATIENCE_S: messages in transit at a quiet moment arrive. Faults that
the actors themselves report count at once.
"""

import contextlib
import signal
import subprocess
import time
from collections import Counter, defaultdict
from collections.abc import Callable

from bus.errors import BusError
from bus_cli.query import Query
from chaos import deeds, judge
from chaos.footprint import Footprint
from chaos.leaver import Leaver
from chaos.plan import Plan
from chaos.report import Tally
from chaos.roles import Ear, Look, Role, Talker
from chaos.stage import PATIENCE_S, Actor, Gone, Stage
from chaos.stories import FAREWELL
from conftest import Daemon
from forks import Fork

STORM_S = 4.0
GRAPH_S = 10.0
"""The graph should be right within a second; a machine that stalls for a few must not fail the run."""

_LOOK_S = 0.05
_QUIET_S = 0.1
"""The time for which busd may hold back reports of drops."""


class Broker(Daemon):
    """A busd; its start does not wait until it is ready."""

    def _wait_until_ready(self, process: "subprocess.Popen[bytes] | Fork") -> None:
        pass


class Failed(Exception):
    """An invariant was violated; with the actors concerned."""

    def __init__(self, invariant: str, complaints: list[str]) -> None:
        super().__init__(f"{invariant}: {complaints[0]}")
        self.invariant = invariant
        self.complaints = complaints


class Director:
    def __init__(self, written: Plan, stage: Stage, daemon: Broker, tally: Tally) -> None:
        self._plan = written
        self._stage = stage
        self._daemon = daemon
        self._tally = tally
        self._scene = judge.Scene()
        self._talkers: dict[int, tuple[Talker, str]] = {}
        self._ears: dict[int, tuple[Ear, str]] = {}
        self._deaths = 0
        self._asleep_s: defaultdict[str, float] = defaultdict(float)  # in the present storm
        self._stopped: dict[str, float] = {}  # since when
        self._dozing: set[str] = set()  # stopped, but connected from the last calm until then
        self._leaving: dict[str, Leaver] = {}
        self._is_broker_stopped = False
        self._cuts: dict[str, int] = {}
        self._baseline: dict[str, Footprint] = {}

    def run(self, time_s: float) -> None:
        """Run storms and calms for `time_s`, but at least two: busd survives every second storm.

        Raises Failed.
        """
        end = time.monotonic() + time_s
        for role in self._plan.cast:
            self._enter(role)
        self._order_all("go")
        time.sleep(1)
        self._calm()  # the resources held then are the limit after each storm
        self._baseline = self._footprints()
        while self._tally.storms < 2 or time.monotonic() + STORM_S < end:
            self._storm(self._plan.storm(STORM_S, spares_broker=self._tally.storms % 2 == 1))
            self._calm()
            self._tally.storms += 1

    def end(self) -> None:
        """Let all actors leave. Raises Failed."""
        for name in tuple(self._stage.actors):
            self._leave(name)
        log = self._daemon.stop()
        if "Traceback" in log or self._daemon.process.returncode:
            raise Failed("busd ends in order", log.splitlines()[-30:])

    # --- a storm

    def _storm(self, script: deeds.Script) -> None:
        self._order_all("go")
        self._asleep_s.clear()
        begin = time.monotonic()
        for at_s, deed in [*script, (STORM_S, None)]:
            if at_s > STORM_S:
                break
            while (left_s := begin + at_s - time.monotonic()) > 0:
                self._look_at_faults()
                self._look_at_leavers()
                time.sleep(min(left_s, _LOOK_S))
            if deed is not None:
                with contextlib.suppress(Gone):
                    self._do(deed)

    def _do(self, deed: deeds.Deed) -> None:
        self._stage.note(repr(deed))
        match deed:
            case deeds.Enter(role):
                self._enter(role).order("go")
            case deeds.Kill(name):
                self._kill(name)
            case deeds.Leave(name):
                self._leaving[name] = Leaver(self._stage.actors[name])
            case deeds.Stop(name):
                self._stop(name)
            case deeds.Doze(name):
                actor = self._stage.actors[name]
                if not self._is_broker_stopped:
                    actor.ask("settle")
                    if actor.look().losses == self._scene.losses[name]:
                        self._dozing.add(name)
                self._stop(name)
            case deeds.Resume(name):
                self._resume(name)
            case deeds.Nap(name, time_s):
                self._asleep_s[name] += time_s
                self._stage.actors[name].order("nap", time_s)
            case deeds.Remake(name, old, new):
                actor = self._stage.actors[name]
                actor.order("end", old)
                actor.order("make", new)
                self._ears.pop(old, None)
                self._know(new, name)
            case deeds.Cut(name, after_bytes, seed):
                self._stage.actors[name].order("cut", (after_bytes, seed))
            case deeds.KillBroker():
                self._daemon.kill()
                self._deaths += 1
            case deeds.StartBroker():
                self._daemon.restart()
            case deeds.RestartBroker():
                self._daemon.stop()
                self._deaths += 1
                self._daemon.restart()
            case deeds.StopBroker():
                self._daemon.process.send_signal(signal.SIGSTOP)
                self._is_broker_stopped = True
            case deeds.ResumeBroker():
                self._daemon.process.send_signal(signal.SIGCONT)
                self._is_broker_stopped = False
        self._tally.deeds[type(deed).__name__] += 1

    def _look_at_leavers(self) -> None:
        """Note leavers that have ended while dozing actors were still connected: these can't reconnect."""
        for leaver in self._leaving.values():
            if leaver.is_seen or self._is_broker_stopped or not leaver.has_ended():
                continue
            with contextlib.suppress(BusError):  # busd may be away
                there = {node[0] for node in self._graph() if len(node) == 1}
                if leaver.name not in there:  # busd has received all of it
                    leaver.is_seen, leaver.witnesses = True, frozenset(self._dozing & there)
                    self._tally.farewells += len(leaver.witnesses)

    def _look_at_faults(self) -> None:
        if self._stage.starved:
            raise Failed("where a cgroup's memory ends, nobody is killed", self._stage.starved)
        if faults := self._stage.faults():
            raise Failed("what arrives is whole, in order, and arrives once", faults)

    # --- a calm

    def _calm(self) -> None:
        self._stage.note("calm")
        self._look_at_leavers()
        self._awake()
        for name, leaver in self._leaving.items():
            leaver.close()
            self._leave(name)
        for name, actor in tuple(self._stage.actors.items()):
            if actor.role.is_limited:
                self._kill(name)  # it may wait for an event that never comes
        self._order_all("rest")
        self._until_right("busd comes back", self._is_away)
        scene = self._look()  # naps are over, and resting talkers have handed everything over
        self._check_graph(scene)
        self._order_all("speak")  # the next message shows losses before it
        self._wait_for_quiet()

        def wrong() -> list[str]:
            nonlocal scene
            scene = self._look()
            return judge.judge(self._scene, scene, trusts_cut_off=FAREWELL in self._plan.stories)

        self._until_right("accounts and streams", wrong)
        self._count(scene)
        judge.note_unsettled(self._scene, scene)
        self._scene = scene
        self._check_history(scene)
        for name in tuple(self._stage.actors):
            if name not in {role.name for role in self._plan.cast}:
                self._leave(name)
        self._check_footprints()
        self._look_at_faults()
        self._leaving.clear()
        self._talkers = {n: pair for n, pair in self._talkers.items() if pair[1] in self._stage.actors}
        self._ears = {n: pair for n, pair in self._ears.items() if pair[1] in self._stage.actors}

    def _wait_for_quiet(self) -> None:
        """Wait until nothing has changed since the look before the last, and busd has answered in between."""
        looks: list[judge.Scene] = []

        def wrong() -> list[str]:
            for _ in range(2):
                self._order_all("settle")
            looks.append(self._look())
            time.sleep(_QUIET_S)
            return [] if looks[-3:].count(looks[-1]) == 3 else ["counters still change"]

        self._until_right("it becomes quiet", wrong)

    def _awake(self) -> None:
        for name in self._stage.actors:
            self._resume(name)
        self._is_broker_stopped = False
        if self._daemon.process.poll() is None:
            self._daemon.process.send_signal(signal.SIGCONT)
        else:
            self._daemon.restart()

    def _stop(self, name: str) -> None:
        self._stage.actors[name].signal(signal.SIGSTOP)
        self._stopped[name] = time.monotonic()

    def _resume(self, name: str) -> None:
        self._dozing.discard(name)
        if name in self._stage.actors and name in self._stopped:
            self._asleep_s[name] += time.monotonic() - self._stopped.pop(name)
            self._stage.actors[name].signal(signal.SIGCONT)

    def _look(self) -> judge.Scene:
        sleepers = {name for name, time_s in self._asleep_s.items() if time_s > deeds.LEASE_S / 2}
        scene = judge.Scene(deaths=self._deaths, sleepers=sleepers, at_s=time.monotonic())
        for name, actor in tuple(self._stage.actors.items()):
            look = self._told(actor)
            scene.losses[name] = look.losses
            self._cuts[name] = look.cuts
            scene.roles[name] = actor.role
            for number, published in look.talkers.items():
                scene.talkers[number] = judge.Said(self._talkers[number][0], name, published, published)
            for number, ear in look.ears.items():
                scene.ears[number] = (self._ears[number][0], name, ear)
        for number, (talker, name) in self._talkers.items():
            if number not in scene.talkers:
                witnesses = self._leaving[name].witnesses if name in self._leaving else frozenset[str]()
                scene.talkers[number] = judge.Said(
                    talker, name, *self._stage.published(number), lives=False, witnesses=witnesses
                )
        return scene

    def _is_away(self) -> list[str]:
        try:
            Query(self._daemon.path, may_start=False).close()
        except BusError as error:
            return [str(error)]
        return []

    def _check_graph(self, scene: judge.Scene) -> None:
        truth = scene.graph()

        def wrong() -> list[str]:
            try:
                found = self._graph()
            except BusError as error:
                return [str(error)]
            return [
                *(f"the graph lacks {' '.join(what)}" for what in truth - found),
                *(f"the graph has {' '.join(what)}, which is no more" for what in found - truth),
            ]

        quiet = time.monotonic()
        self._until_right("the graph equals the truth", wrong, GRAPH_S)
        self._tally.graph_s.append(time.monotonic() - quiet)

    def _graph(self) -> Counter[tuple[str, ...]]:
        """Nodes, and endpoints with their kind and topic. Raises BusError."""
        with Query(self._daemon.path, may_start=False) as query:
            graph = query.graph()
        found: Counter[tuple[str, ...]] = Counter((node.name,) for node in graph.nodes)
        for one in (*graph.publishers, *graph.subscriptions):
            found[one.node.name, one.kind, one.topic] += 1
        return found

    def _check_history(self, scene: judge.Scene) -> None:
        role = self._plan.visitor()
        visitor = self._enter(role)
        talkers = [said for number, said in scene.talkers.items() if scene.lives(number)]

        def wrong() -> list[str]:
            ears = self._told(visitor).ears
            return [
                complaint
                for number, look in ears.items()
                for complaint in judge.history(talkers, self._ears[number][0], look)
            ]

        self._until_right("late joiners get the history", wrong)
        if complaints := wrong():  # nothing may come after it, either
            raise Failed("late joiners get the history", complaints)
        self._leave(role.name)

    def _check_footprints(self) -> None:
        if not self._baseline:
            return

        def wrong() -> list[str]:
            return [
                f"{name} {complaint}"
                for name, footprint in self._footprints().items()
                for complaint in footprint.beyond(self._baseline[name])
            ]

        self._until_right("nothing grows", wrong)

    def _footprints(self) -> dict[str, Footprint]:
        pids = {name: actor.pid for name, actor in self._stage.actors.items()}
        return {name: Footprint(pid) for name, pid in {"busd": self._daemon.pid, **pids}.items()}

    def _until_right(
        self, invariant: str, wrong: Callable[[], list[str]], patience_s: float = PATIENCE_S
    ) -> None:
        end = time.monotonic() + patience_s
        while complaints := wrong():
            self._look_at_faults()
            if time.monotonic() > end:
                raise Failed(invariant, complaints)
            time.sleep(_LOOK_S)
        self._tally.checks[invariant] += 1

    # --- actors

    def _enter(self, role: Role) -> Actor:
        for endpoint in role.endpoints:
            self._know(endpoint, role.name)
        self._tally.actors += 1
        return self._stage.enter(role)

    def _told(self, actor: Actor) -> Look:
        try:
            return actor.look()
        except (Gone, TimeoutError) as error:
            name = actor.role.name
            raise Failed("nobody ends unasked", [f"{name}: {error!r}"]) from None

    def _know(self, endpoint: Talker | Ear, name: str) -> None:
        if isinstance(endpoint, Talker):
            self._talkers[endpoint.number] = endpoint, name
        else:
            self._ears[endpoint.number] = endpoint, name

    def _order_all(self, order: str) -> None:
        for actor in self._stage.actors.values():
            with contextlib.suppress(Gone):
                actor.order(order)

    def _kill(self, name: str) -> None:
        is_limited = self._stage.actors[name].role.is_limited
        status = self._stage.kill(name)
        failures = [line for line in self._stage.last_lines(name, 10_000) if line.startswith("failed:")]
        self._tally.suffered.update(line.split()[1].rstrip(":") for line in failures)
        if status != -signal.SIGKILL and not is_limited:
            raise Failed("nobody ends unasked", [f"{name} ended with {status}"])

    def _leave(self, name: str) -> None:
        status = self._stage.leave(name)
        if status:
            raise Failed("who is asked to leave ends in order", [f"{name} ended with {status}"])

    def _count(self, scene: judge.Scene) -> None:
        self._tally.cuts = sum(self._cuts.values())
        for number, said in scene.talkers.items():
            before = self._scene.talkers.get(number)
            self._tally.published += said.most - (before.most if before else 0)
        for number, (_, _, look) in scene.ears.items():
            then = self._scene.ears[number][2] if number in self._scene.ears else None
            self._tally.delivered += look.delivered - (then.delivered if then else 0)
            self._tally.dropped.update(look.dropped)
            if then is not None:
                self._tally.dropped.subtract(then.dropped)

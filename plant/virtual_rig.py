"""The rig on a virtual card: for training and tests, without hardware."""

from dataclasses import replace

from plant.breakage import ONLY_OF_A_CARD, Breakage, Broken
from plant.card import WATCHDOG_S, Card, CardState
from plant.daq import Daq
from plant.hand import Hand
from plant.interface import Measurement, ShaftLoad
from plant.obstacle import Obstacle
from plant.rig import Rig
from plant.simulator import Simulator
from plant.virtual_card import VirtualCard
from plant.wiring import Wiring, wired_alike


class VirtualRig(Rig):
    """A rig at a virtual card: what moves can be pushed, loaded and broken to order.

    With ``registers`` it runs in real time under their watchdog, whose time is that of the simulated card: a virtual
    machine pauses for longer than a rig may be left alone. Without, it is stepped as fast as it goes, unwatched.
    ``has_clock``: the card offers hardware timing; None: in real time only.

    ``as_wired`` is how the card really is wired, where that is not as the wiring says: then it has to be brought up
    like any rig. Else it stands at its zero when it is made, and may be controlled at once.
    """

    pushes = True
    loads_shafts = True

    def __init__(
        self,
        wiring: Wiring,
        simulator: Simulator,
        registers: Card | None = None,
        as_wired: Wiring | None = None,
        *,
        directions_proven: bool = False,
        load_cells_measured: bool = False,
        has_clock: bool | None = None,
        drives_off: bool = False,
        wired: str = "",
    ) -> None:
        wiring = replace(wiring, card=replace(wiring.card, watchdog_s=WATCHDOG_S))
        self._watched = registers is not None
        self.stepped = not self._watched
        self._card_registers = registers or Card.create()
        if self._watched:
            self._card_registers.start_watchdog()
        true = wiring if as_wired is None else as_wired
        has_clock = self._watched if has_clock is None else has_clock
        self.card = VirtualCard(true, simulator, self._card_registers, has_clock=has_clock)
        self._simulator = simulator
        right = as_wired is None or wired_alike(wiring, as_wired)
        super().__init__(
            wiring,
            Daq(wiring, self.card.options),
            directions_proven=directions_proven or right,
            load_cells_measured=load_cells_measured or right,
            drives_off=drives_off,
            wired=wired,
        )
        self.zeroed = right

    def _described(self) -> str:
        return f"virtual card, {super()._described()}"

    def _measure_cycle(self) -> None:
        """Spare it: each write would move what is simulated."""

    def _prove_watchdog(self) -> None:
        if self._watched:
            super()._prove_watchdog()
        self._watchdog_tried = True

    def card_state(self) -> CardState:
        """Return what the card puts out, as anybody may see it."""
        return self._card_registers.state()

    def read(self) -> Measurement:
        """Return what the sensors say now, the push, and the force of a wall. Raises PlantError."""
        m, simulator = super().read(), self._simulator
        return m._replace(F_push=simulator.F_push, F_wall=simulator.F_wall)

    def push(self, F_push: float) -> None:
        """Apply an external force [N] from the next period on."""
        self._simulator.push(F_push)

    def load(self, load: ShaftLoad) -> None:
        """Load the motors' shafts from the next period on. Raises PlantError."""
        self._simulator.load(load)

    def obstacle(self, obstacle: Obstacle | None) -> None:
        """Put a wall in the joint's way from the next period on, None takes it away. Raises PlantError."""
        self._simulator.obstacle(obstacle)

    def inject(self, broken: Broken | None) -> None:
        """Break something of the card or of the simulated plant, None to mend it."""
        of_the_card = broken is not None and broken.kind in ONLY_OF_A_CARD
        self.card.inject(broken if of_the_card else None)
        self._simulator.inject(None if of_the_card else broken)
        if broken is not None and broken.kind is Breakage.WATCHDOG_DEATH:
            self._card_registers.kill_watchdog()

    def by_hand(self, hand: Hand) -> None:
        """Let a hand act from the next period on."""
        self.card.by_hand(hand)

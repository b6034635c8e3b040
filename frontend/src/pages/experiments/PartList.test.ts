import { expect, test } from "vitest";
import { fillText } from "../../samples/texts";
import { SAMPLE } from "./document";
import { differences } from "./OwnExperiments";
import { describePart, describePlayed, partOf } from "./PartList";
import { TEXTS } from "./texts";

const RAD = Math.PI / 180;

test("describes the target of a ramp, and its start and speed once it is scheduled", () => {
  const ramp = { do: "ramp", q_ref: 60 * RAD, duration_s: 4 };
  expect(describePart(ramp, "deg")).toBe("Ramp q to 60° in 4 s");
  const played = {
    path: [],
    start_s: 6,
    end_s: 10,
    pieces: 1,
    piece_s: 4,
    q_from: -60 * RAD,
    S_from: 10,
    q_to: 60 * RAD,
    S_to: 10,
  };
  expect(describePlayed(ramp, played, "deg")).toBe("t = 6 to 10 s, q from −60°, 30°/s");
});

test("describes the cycles of a sine and its largest speed, a·2π/T", () => {
  const sine = { do: "sine", q_amplitude: 0.5, period_s: 4, duration_s: 8 };
  expect(describePart(sine, "rad")).toBe("Sine on q: ±0.5 rad, period 4 s, 8 s (2 cycles), max 0.785 rad/s");
});

test("describes the crest of a sine, and the push during a motion", () => {
  const sine = { do: "sine", q_ref: -0.1, S_ref: 12, period_s: 4, duration_s: 4, F_push: -3 };
  expect(describePart(sine, "rad")).toBe(
    "Sine on q: crest at −0.1 rad, S: crest at 12 N·m/rad, period 4 s, 4 s (1 cycle), " +
      "push −3 N (simulated plants only)",
  );
  expect(describePart({ do: "ramp", q_ref: 0.2, duration_s: 1, F_push: "depth" }, "rad")).toBe(
    "Ramp q to 0.2 rad in 1 s, push depth (simulated plants only)",
  );
  expect(describePart({ do: "step", q_ref: 0.2, duration_s: 1, F_push: 0 }, "rad")).toBe(
    "Step q to 0.2 rad; hold 1 s",
  );
});

test("does not convert the target of a step to the crest of a sine", () => {
  const step = { do: "step", q_ref: 0.2, S_ref: 12, duration_s: 4, F_push: 2 };
  const sine = partOf("sine", step);
  expect(sine).toMatchObject({ do: "sine", duration_s: 4, period_s: 4, F_push: 2 });
  expect([sine.q_ref, sine.S_ref]).toEqual([undefined, undefined]);
  const crest = { do: "sine", q_ref: 0.2, S_ref: 12, period_s: 2, duration_s: 4 };
  expect(partOf("ramp", crest)).toEqual({ do: "ramp", q_ref: 0.2, S_ref: 12, duration_s: 4 });
});

test("shows an expression as written", () => {
  expect(describePart({ do: "hold", duration_s: "2 * hold_s" }, "deg")).toBe(
    fillText(TEXTS.describeHold, { time: "2 * hold_s" }),
  );
});

test("describes added and removed parts and criteria between versions", () => {
  const [phase] = SAMPLE.phases;
  const next = {
    ...SAMPLE,
    phases: [
      {
        name: "sequence",
        title: "Sequence",
        parts: [...(phase?.parts.slice(0, 2) ?? []), { do: "hold", duration_s: 3 }],
      },
    ],
    criteria: [{ figure: "min_tension_N", above: 3 }],
  };
  expect(differences(SAMPLE, next, "deg")).toEqual([
    fillText(TEXTS.removed, { line: fillText(TEXTS.describeHold, { time: "2 s" }) }),
    fillText(TEXTS.added, { line: fillText(TEXTS.describeHold, { time: "3 s" }) }),
    fillText(TEXTS.removed, { line: "min_tension_N above 2" }),
    fillText(TEXTS.added, { line: "min_tension_N above 3" }),
  ]);
  expect(differences(SAMPLE, SAMPLE, "deg")).toEqual([]);
});

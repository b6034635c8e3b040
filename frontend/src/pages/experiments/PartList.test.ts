import { expect, test } from "vitest";
import { SAMPLE } from "./document";
import { differences } from "./OwnExperiments";
import { describePart, describePlayed, partOf } from "./PartList";

const RAD = Math.PI / 180;

test("a ramp says where it goes, and from where and how fast once it is laid out", () => {
  const ramp = { do: "ramp", q_ref: 60 * RAD, duration_s: 4 };
  expect(describePart(ramp, "deg")).toBe("ramps q to 60° in 4 s");
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
  expect(describePlayed(ramp, played, "deg")).toBe("at 6 to 10 s, q from −60°, 30°/s");
});

test("a sine says its turns and how fast it is at most, a·2π/T", () => {
  const sine = { do: "sine", q_amplitude: 0.5, period_s: 4, duration_s: 8 };
  expect(describePart(sine, "rad")).toBe(
    "swings q by ±0.5 rad with a period of 4 s, 2 turns, for 8 s, 0.785 rad/s at most",
  );
});

test("a sine may say its crest, and a motion the push beside it", () => {
  const sine = { do: "sine", q_ref: -0.1, S_ref: 12, period_s: 4, duration_s: 4, F_push: -3 };
  expect(describePart(sine, "rad")).toBe(
    "swings q to −0.1 rad at the crest and S to 12 N·m/rad at the crest with a period of 4 s, 1 turn, for 4 s, " +
      "pushed with −3 N, on the simulator",
  );
  expect(describePart({ do: "ramp", q_ref: 0.2, duration_s: 1, F_push: "depth" }, "rad")).toBe(
    "ramps q to 0.2 rad in 1 s, pushed with depth, on the simulator",
  );
  expect(describePart({ do: "step", q_ref: 0.2, duration_s: 1, F_push: 0 }, "rad")).toBe(
    "jumps q to 0.2 rad, stays 1 s",
  );
});

test("where a step went is no crest of the sine that takes its place", () => {
  const step = { do: "step", q_ref: 0.2, S_ref: 12, duration_s: 4, F_push: 2 };
  const sine = partOf("sine", step);
  expect(sine).toMatchObject({ do: "sine", duration_s: 4, period_s: 4, F_push: 2 });
  expect([sine.q_ref, sine.S_ref]).toEqual([undefined, undefined]);
  const crest = { do: "sine", q_ref: 0.2, S_ref: 12, period_s: 2, duration_s: 4 };
  expect(partOf("ramp", crest)).toEqual({ do: "ramp", q_ref: 0.2, S_ref: 12, duration_s: 4 });
});

test("an expression stands as it is written", () => {
  expect(describePart({ do: "hold", duration_s: "2 * hold_s" }, "deg")).toBe(
    "holds the references for 2 * hold_s",
  );
});

test("versions differ by what came, what went and what has to hold", () => {
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
    "without “holds the references for 2 s”",
    "with “holds the references for 3 s”",
    "without “min_tension_N above 2”",
    "with “min_tension_N above 3”",
  ]);
  expect(differences(SAMPLE, SAMPLE, "deg")).toEqual([]);
});

import { expect, it } from "vitest";
import { SampleWindow } from "../../samples/window";
import { movement, signalsOf } from "./StepCard";

const PERIOD_S = 0.001;

/** Returns a window of one signal with `ticks` samples of `value(t)`. */
function recorded(name: string, ticks: number, value: (t: number) => number): SampleWindow {
  const window = new SampleWindow([name]);
  const column = Float32Array.from({ length: ticks }, (_, tick) => value(tick * PERIOD_S));
  window.append({ firstTick: 0, count: ticks, missed: 0, columns: [column] } as unknown as Parameters<
    SampleWindow["append"]
  >[0]);
  return window;
}

/** Noise of a load cell, 0.05 N, without random numbers: two sines that do not repeat within the window. */
const noise = (t: number) => 0.05 * (Math.sin(4321 * t) + Math.sin(2777 * t));

it.each([
  ["q", (t: number) => 0.05 * t, "rising"],
  ["theta_A", (t: number) => -0.05 * t, "falling"],
  ["q", (t: number) => 0.00157 * Math.round(t % 0.002), "still"],
  ["F_A", (t: number) => 0.1 + noise(t), "still"],
  ["F_B", (t: number) => 5 * t + noise(t), "rising"],
  ["F_B", (t: number) => 20 - 5 * t + noise(t), "falling"],
] as const)("distinguishes a movement by hand from noise: %s %#", (name, value, expected) => {
  expect(movement(recorded(name, 1000, value), name, PERIOD_S)).toBe(expected);
});

it("returns unknown for too few samples and for NaN", () => {
  expect(
    movement(
      recorded("q", 200, () => 0),
      "q",
      PERIOD_S,
    ),
  ).toBe("unknown");
  expect(
    movement(
      recorded("F_A", 1000, (t) => (t < 0.95 ? 1 : Number.NaN)),
      "F_A",
      PERIOD_S,
    ),
  ).toBe("unknown");
});

it("selects sensor signals while the motors are off, and voltages in steps with motors", () => {
  expect(signalsOf("wiring_test")).toEqual(["q", "theta_A", "theta_B", "F_A", "F_B"]);
  expect(signalsOf("calibrate")).toEqual(["F_A", "F_B", "V_A", "V_B"]);
  expect(signalsOf("direction")).toContain("u_A");
});

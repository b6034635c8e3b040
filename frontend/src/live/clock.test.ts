import { describe, expect, it } from "vitest";
import { SampleClock } from "./clock";

describe("SampleClock", () => {
  it("runs evenly although frames come early and late", () => {
    const clock = new SampleClock();
    const jitter = [0, 0.012, -0.008, 0.02, 0.003];
    for (let frame = 0; frame < 300; frame++) {
      clock.observe(frame * 0.033, 100 + frame * 0.033 + (jitter[frame % 5] as number));
    }
    const last = 299 * 0.033;
    const shown = clock.at(100 + last);
    expect(Math.abs(shown - last)).toBeLessThan(0.02);
    expect(clock.at(100 + last + 0.016) - shown).toBeCloseTo(0.016, 6);
  });

  it("stands still shortly after the last sample", () => {
    const clock = new SampleClock();
    clock.observe(10, 0);
    expect(clock.at(60)).toBeCloseTo(10.05, 6);
  });

  it("jumps after a pause instead of catching up", () => {
    const clock = new SampleClock();
    clock.observe(10, 0);
    clock.observe(10.1, 5);
    expect(clock.at(5)).toBeCloseTo(10.1, 6);
  });
});

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

  it("tells how old the newest sample is, while frames come late and while none come", () => {
    const clock = new SampleClock();
    expect(clock.age(0)).toBeNull();
    for (let frame = 0; frame <= 300; frame++) clock.observe(frame * 0.033, 100 + frame * 0.033);
    const now_s = 109.9;
    expect(clock.age(now_s)).toBeCloseTo(0, 3);
    expect(clock.age(now_s + 2)).toBeCloseTo(2, 3);
    // the page was asleep for 5 s: what waited comes in at once, the newest of it last
    const ages = Array.from({ length: 150 }, (_, frame) => {
      clock.observe(9.9 + (frame + 1) * 0.0333, now_s + 5 + frame * 1e-4);
      return clock.age(now_s + 5 + frame * 1e-4) as number;
    });
    expect(ages[0]).toBeGreaterThan(4.5);
    expect(ages[100]).toBeGreaterThan(0.3); // grey on the page
    expect(ages.at(-1)).toBeLessThan(0.1);
  });

  it("believes by and by that the loop has stood still", () => {
    const clock = new SampleClock();
    clock.observe(10, 0);
    let until_s = 0;
    for (let frame = 0; (clock.age(3600 + frame * 0.033) ?? 0) > 0.1 && frame < 3000; frame++) {
      until_s = frame * 0.033;
      clock.observe(10 + until_s, 3600 + until_s);
    }
    expect(until_s).toBeLessThan(25);
  });
});

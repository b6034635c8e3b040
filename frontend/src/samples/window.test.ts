import { describe, expect, it } from "vitest";
import type { Frame } from "../wire/frame";
import { SampleWindow } from "./window";

function frame(firstTick: number, values: number[]): Frame {
  return { firstTick, count: values.length, missed: 0, columns: [Float32Array.from(values)] };
}

function ramp(firstTick: number, count: number): Frame {
  return frame(
    firstTick,
    Array.from({ length: count }, (_, index) => firstTick + index),
  );
}

describe("SampleWindow", () => {
  it("keeps what fits and forgets the oldest", () => {
    const window = new SampleWindow(["q"], 64);
    for (let tick = 0; tick < 200; tick += 10) window.append(ramp(tick, 10));
    expect(window.endTick).toBe(200);
    expect(window.at("q", 199)).toBe(199);
    expect(window.at("q", window.startTick)).toBe(window.startTick);
    expect(window.at("q", window.startTick - 1)).toBeNaN();
    expect(window.length).toBeGreaterThanOrEqual(48);
    expect(window.length).toBeLessThanOrEqual(64);
  });

  it("shows missed samples as a hole", () => {
    const window = new SampleWindow(["q"], 64);
    window.append(ramp(0, 5));
    window.append(ramp(8, 2));
    expect([4, 5, 6, 7, 8].map((tick) => window.at("q", tick))).toEqual([
      4,
      Number.NaN,
      Number.NaN,
      Number.NaN,
      8,
    ]);
  });

  it("takes history again after a reconnection without doubling it", () => {
    const window = new SampleWindow(["q"], 64);
    window.append(ramp(0, 30));
    window.append(frame(20, [-1, -2, -3]));
    expect(window.endTick).toBe(23);
    expect(window.at("q", 19)).toBe(19);
    expect(window.at("q", 22)).toBe(-3);
    window.append(ramp(23, 2));
    expect(window.at("q", 24)).toBe(24);
  });

  it("starts anew when the loop did, and after a gap longer than itself", () => {
    const window = new SampleWindow(["q"], 64);
    window.append(ramp(1000, 10));
    window.append(ramp(0, 4));
    expect([window.startTick, window.endTick]).toEqual([0, 4]);
    window.append(ramp(5000, 4));
    expect([window.startTick, window.endTick]).toEqual([5000, 5004]);
  });

  it("takes a frame longer than itself", () => {
    const window = new SampleWindow(["q"], 64);
    window.append(ramp(0, 300));
    expect(window.newest("q")).toBe(299);
    expect(window.at("q", window.startTick)).toBe(window.startTick);
  });

  it("knows no other signals and no capacity but a power of two", () => {
    expect(new SampleWindow(["q"], 64).at("S", 0)).toBeNaN();
    expect(() => new SampleWindow(["q"], 100)).toThrow(/power of two/);
  });
});

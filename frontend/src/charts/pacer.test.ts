import { describe, expect, it } from "vitest";
import { FramePacer } from "./pacer";

/** Times at which a pacer draws when drawn frames take `cost_ms` and idle ones 16 ms. */
function draws(pacer: FramePacer, cost_ms: number, until_ms: number): number[] {
  const times: number[] = [];
  let now_ms = 0;
  while (now_ms < until_ms) {
    const due = pacer.due(now_ms);
    if (due) {
      times.push(now_ms);
      pacer.drew(now_ms);
    }
    now_ms += due ? cost_ms : 16;
  }
  return times;
}

describe("FramePacer", () => {
  it("draws on every frame where that is cheap", () => {
    expect(draws(new FramePacer(1), 16, 1600)).toHaveLength(100);
  });

  it("leaves as long to others as a slow frame took", () => {
    const times = draws(new FramePacer(1), 200, 10_000);
    expect(times.length).toBeGreaterThan(20);
    expect((times.length * 200) / 10_000).toBeLessThanOrEqual(0.52);
  });

  it("leaves more when told to", () => {
    const times = draws(new FramePacer(4), 200, 10_000);
    expect((times.length * 200) / 10_000).toBeLessThanOrEqual(0.22);
  });

  it("goes back to full speed when frames are cheap again", () => {
    const pacer = new FramePacer(1);
    draws(pacer, 300, 3000);
    pacer.due(1e6);
    const start = 1e6 + 1e4;
    pacer.due(start);
    pacer.drew(start);
    expect(pacer.due(start + 16)).toBe(true);
  });
});

import { describe, expect, it } from "vitest";
import { FramePacer, paceWindow } from "./pacer";

/** Times at which a pacer draws when drawn frames take `cost_ms` and idle frames 16 ms. */
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
  it("draws on every frame while frames are fast", () => {
    expect(draws(new FramePacer(1), 16, 1600)).toHaveLength(100);
  });

  it("pauses for the duration of a slow frame", () => {
    const times = draws(new FramePacer(1), 200, 10_000);
    expect(times.length).toBeGreaterThan(20);
    expect((times.length * 200) / 10_000).toBeLessThanOrEqual(0.52);
  });

  it("pauses longer with a larger factor", () => {
    const times = draws(new FramePacer(4), 200, 10_000);
    expect((times.length * 200) / 10_000).toBeLessThanOrEqual(0.22);
  });

  it("returns to full speed when frames are fast again", () => {
    const pacer = new FramePacer(1);
    draws(pacer, 300, 3000);
    pacer.due(1e6);
    const start = 1e6 + 1e4;
    pacer.due(start);
    pacer.drew(start);
    expect(pacer.due(start + 16)).toBe(true);
  });
});

/** A window with a frame every 16 ms, delayed by the work of the previous frame. */
function pacedWindow(rest: number) {
  const due: FrameRequestCallback[] = [];
  const view = { now_ms: 0, late_ms: 0, requestAnimationFrame: (one: FrameRequestCallback) => due.push(one) };
  const run = (until_ms: number) => {
    while (view.now_ms < until_ms) {
      view.now_ms += 16 + view.late_ms;
      view.late_ms = 0;
      for (const one of due.splice(0)) one(view.now_ms);
    }
  };
  paceWindow(view as unknown as Window, new FramePacer(rest));
  return { view, run };
}

describe("paceWindow", () => {
  it("does not take an idle window for a slow frame", () => {
    const { view, run } = pacedWindow(4);
    const drawn: number[] = [];
    for (const at_ms of [0, 1000, 60_000]) {
      run(at_ms);
      view.requestAnimationFrame((now_ms) => drawn.push(now_ms - at_ms));
    }
    run(61_000);
    expect(drawn).toHaveLength(3);
    expect(Math.max(...drawn)).toBeLessThanOrEqual(40);
  });

  it("pauses a window that requests each frame at once, from the first slow frame on", () => {
    const { view, run } = pacedWindow(4);
    const drawn: number[] = [];
    const draw = (now_ms: number) => {
      view.requestAnimationFrame(draw);
      drawn.push(now_ms);
      if (drawn.length > 2) view.late_ms = 300;
    };
    view.requestAnimationFrame(draw);
    run(20_000);
    const gaps = drawn.slice(3).map((now_ms, index) => now_ms - (drawn[index + 2] ?? 0));
    expect(drawn.length).toBeGreaterThan(8);
    expect(Math.min(...gaps)).toBeGreaterThanOrEqual(316 + 4 * 316);
  });

  it("does not pause for as long as a window was hidden", () => {
    const { view, run } = pacedWindow(4);
    view.requestAnimationFrame(() => {
      view.late_ms = 600_000;
    });
    run(600_100);
    const drawn: number[] = [];
    view.requestAnimationFrame((now_ms) => drawn.push(now_ms));
    run(610_000);
    expect(drawn[0]).toBeLessThan(600_032 + 2100);
  });

  it("pauses a window after a slow frame, even if it requests the next frame later", () => {
    const { view, run } = pacedWindow(4);
    view.requestAnimationFrame(() => {
      view.late_ms = 300;
    });
    run(400);
    const drawn: number[] = [];
    view.requestAnimationFrame((now_ms) => drawn.push(now_ms));
    run(3000);
    expect(drawn[0]).toBeGreaterThanOrEqual(16 + 316 + 4 * 316);
    expect(drawn[0]).toBeLessThan(16 + 316 + 4 * 316 + 40);
  });
});

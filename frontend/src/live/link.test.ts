import { describe, expect, it } from "vitest";
import { firstLink, health, type Link, type LinkEvent, step } from "./link";

/** Plays events at their times; returns the last state and all actions other than `none`. */
function play(events: readonly (readonly [number, LinkEvent])[], from: Link = firstLink(0)) {
  const actions: string[] = [];
  let link = from;
  for (const [now_ms, event] of events) {
    const [next, action] = step(link, event, now_ms);
    link = next;
    if (action !== "none") actions.push(`${now_ms} ${action}`);
  }
  return { link, actions };
}

const clock = (now_ms: number): [number, LinkEvent] => [now_ms, { kind: "clock" }];

describe("link", () => {
  it("measures the round-trip time", () => {
    const { link } = play([
      [100, { kind: "opened" }],
      [130, { kind: "pong", sent_ms: 100 }],
    ]);
    expect(link.latency_ms).toBe(30);
    expect(health(link, 200)).toBe("live");
  });

  it("pings about once a second while open", () => {
    const received: [number, LinkEvent][] = [500, 1500, 2500].map((now_ms) => [now_ms, { kind: "received" }]);
    const events = [...received, ...[600, 1100, 1600, 2100, 2600].map(clock)].sort((a, b) => a[0] - b[0]);
    expect(play([[0, { kind: "opened" }], ...events]).actions).toEqual(["0 ping", "1100 ping", "2100 ping"]);
  });

  it("marks values as stale after a second and drops a silent connection", () => {
    const open = play([[0, { kind: "opened" }]]).link;
    expect(health(open, 900)).toBe("live");
    expect(health(open, 1200)).toBe("stale");
    const { link, actions } = play([600, 1200, 1800, 2400, 2900, 3100].map(clock), open);
    expect(actions.at(-1)).toBe("3100 drop");
    expect(health(link, 3100)).toBe("down");
  });

  it("does not take a suspension of the page for a silent connection", () => {
    const open = play([[0, { kind: "opened" }]]).link;
    const woken = play([clock(60_000), clock(60_500), clock(61_000)], open);
    expect(woken.actions).not.toContain("60000 drop");
    expect(woken.link.phase).toBe("open");
    const silent = play([61_500, 62_000, 62_500, 63_000, 63_200].map(clock), woken.link);
    expect(silent.actions.at(-1)).toBe("63200 drop");
  });

  it("retries without limit, with delays that grow to four seconds", () => {
    let link = firstLink(0);
    let now_ms = 0;
    const delays: number[] = [];
    for (let attempt = 0; attempt < 20; attempt++) {
      [link] = step(link, { kind: "closed" }, now_ms);
      delays.push(link.retry_ms - now_ms);
      expect(step(link, { kind: "clock" }, link.retry_ms - 1)[1]).toBe("none");
      now_ms = link.retry_ms;
      const [next, action] = step(link, { kind: "clock" }, now_ms);
      expect(action).toBe("connect");
      link = next;
    }
    expect(delays.slice(0, 6)).toEqual([250, 500, 1000, 2000, 4000, 4000]);
  });

  it("returns to short delays once it has received a message", () => {
    const { link } = play([
      [0, { kind: "closed" }],
      [250, { kind: "clock" }],
      [300, { kind: "closed" }],
      [800, { kind: "clock" }],
      [810, { kind: "opened" }],
      [820, { kind: "received" }],
      [900, { kind: "closed" }],
    ]);
    expect(link.retry_ms).toBe(1150);
  });

  it("retries at once when the network returns, and drops an attempt that hangs", () => {
    const lost = play([[0, { kind: "closed" }]]).link;
    expect(step(lost, { kind: "wake" }, 10)[1]).toBe("connect");
    const tries = play([900, 1800, 2700, 3600, 4500, 5100].map(clock));
    expect(tries.actions).toEqual(["5100 drop"]);
  });

  it("is down before the first message", () => {
    expect(health(firstLink(0), 10)).toBe("down");
  });
});

import { describe, expect, it } from "vitest";
import { withShortPaths } from "./plot";

/** Where a path of M, l, h and v leads, point by point. */
function points(d: string): [number, number][] {
  let [x, y] = [0, 0];
  return [...d.matchAll(/([Mlhv])([^Mlhv]*)/g)].map(([, letter, rest = ""]) => {
    const [a = 0, b = 0] = (rest.match(/-?\d*\.?\d+/g) ?? []).map(Number);
    if (letter === "M") [x, y] = [a, b];
    else if (letter === "h") x += a;
    else if (letter === "v") y += a;
    else [x, y] = [x + a, y + b];
    return [x, y];
  });
}

function pathOf(svg: string): string {
  return / d="([^"]*)"/.exec(svg)?.[1] ?? "";
}

describe("withShortPaths", () => {
  it("leads through the same points to a twentieth of a unit, however many there are", () => {
    const wave = Array.from({ length: 4000 }, (_, n) => [70 + n * 0.2031, 200 + 99 * Math.sin(n)] as const);
    const plain = wave.map(([x, y], n) => `${n === 0 ? "M" : "L"}${x.toFixed(2)} ${y.toFixed(2)}`).join("");
    const short = pathOf(withShortPaths(`<path d="${plain}"/>`));
    expect(short.length).toBeLessThan(0.75 * plain.length);
    const found = points(short);
    expect(found).toHaveLength(wave.length);
    for (const [n, [x, y]] of found.entries()) {
      expect(Math.abs(x - (wave[n]?.[0] ?? 0))).toBeLessThan(0.0551);
      expect(Math.abs(y - (wave[n]?.[1] ?? 0))).toBeLessThan(0.0551);
    }
  });

  it("makes one step of what goes on level, leaves out what does not move, and keeps gaps", () => {
    const svg = '<path d="M1 2L2 2L3.5 2L3.51 2.01L3 2L3 1.5M5 -4L5.04 -3.96L6 -3"/>';
    expect(pathOf(withShortPaths(svg))).toBe("M1 2h2.5h-.5v-.5M5 -4l1 1");
  });

  it("leaves alone what is no curve", () => {
    const svg = '<path d="M70 26v130"/><path d="M70 26h20"/><text>d="M1 2L3 4x"</text>';
    expect(withShortPaths(svg)).toBe(svg);
  });
});

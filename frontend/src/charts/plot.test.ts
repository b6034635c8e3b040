import { afterEach, describe, expect, it, vi } from "vitest";
import { linePath, withShortPaths } from "./plot";

describe("line path", () => {
  class RecordedPath {
    readonly steps: string[] = [];
    moveTo(x: number, y: number): void {
      this.steps.push(`M${x},${y}`);
    }
    lineTo(x: number, y: number): void {
      this.steps.push(`L${x},${y}`);
    }
  }

  /** Path of values at times 0, 1, 2 … on a plot of one pixel per unit, 100 high. */
  function steps(values: number[]): string {
    vi.stubGlobal("Path2D", RecordedPath);
    const plot = {
      data: [Float64Array.from(values.keys()), Float64Array.from(values)],
      scales: { x: { min: 0, max: 100 }, y: { min: 0, max: 100 } },
      bbox: { left: 0, top: 0, width: 100, height: 100 },
    };
    const paths = linePath(plot as unknown as Parameters<typeof linePath>[0], 1, 0, values.length - 1);
    return (paths.stroke as unknown as RecordedPath).steps.join(" ");
  }

  afterEach(() => vi.unstubAllGlobals());

  describe("linePath", () => {
    it("joins the points", () => {
      expect(steps([10, 20, 15])).toBe("M0,90 L1,80 L2,85");
    });

    it("interrupts the line at missing samples", () => {
      expect(steps([10, Number.NaN, Number.NaN, 30, 40])).toBe("M0,90 M3,70 L4,60");
    });

    it("draws only the ends of a horizontal section", () => {
      expect(steps([10, 10, 10, 10, 50, 50, 50])).toBe("M0,90 L3,90 L4,50 L6,50");
      expect(steps([10, 10, 10, Number.NaN, 20])).toBe("M0,90 L2,90 M4,80");
    });
  });
});

describe("short paths", () => {
  /** Points of a path of M, l, h and v. */
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
    it("passes through the same points within a twentieth of a unit, for any number of points", () => {
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

    it("joins horizontal steps, omits steps of zero, and preserves gaps", () => {
      const svg = '<path d="M1 2L2 2L3.5 2L3.51 2.01L3 2L3 1.5M5 -4L5.04 -3.96L6 -3"/>';
      expect(pathOf(withShortPaths(svg))).toBe("M1 2h2.5h-.5v-.5M5 -4l1 1");
    });

    it("does not change other elements than curves", () => {
      const svg = '<path d="M70 26v130"/><path d="M70 26h20"/><text>d="M1 2L3 4x"</text>';
      expect(withShortPaths(svg)).toBe(svg);
    });
  });
});

import { afterEach, describe, expect, it, vi } from "vitest";
import { linePath } from "./plot";

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

  it("lifts the pen over missing samples", () => {
    expect(steps([10, Number.NaN, Number.NaN, 30, 40])).toBe("M0,90 M3,70 L4,60");
  });

  it("keeps only the ends of a level stretch", () => {
    expect(steps([10, 10, 10, 10, 50, 50, 50])).toBe("M0,90 L3,90 L4,50 L6,50");
    expect(steps([10, 10, 10, Number.NaN, 20])).toBe("M0,90 L2,90 M4,80");
  });
});

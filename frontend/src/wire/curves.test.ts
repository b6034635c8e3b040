import { describe, expect, it, test } from "vitest";
import { decodeCurves, excerptOf, fromCsv } from "./curves";

describe("curves", () => {
  /** Packed here by hand, as backend/wire.py describes it. */
  function packed(width_s: number, first: bigint, perBucket: number, columns: number[][]): ArrayBuffer {
    const count = columns[0]?.length ?? 0;
    const message = new ArrayBuffer(24 + 4 * count * columns.length);
    const view = new DataView(message);
    view.setFloat64(0, width_s, true);
    view.setBigUint64(8, first, true);
    view.setUint32(16, count, true);
    view.setUint32(20, perBucket, true);
    for (const [index, value] of columns.flat().entries()) view.setFloat32(24 + 4 * index, value, true);
    return message;
  }

  test("an envelope has smallest and largest values at fixed places", () => {
    const message = packed(0.5, 3n, 2, [
      [1, 2],
      [5, 6],
      [-1, Number.NaN],
      [0, Number.NaN],
    ]);
    const excerpt = decodeCurves(message, ["q", "S"]);
    expect(excerpt.raw).toBe(false);
    expect([...excerpt.t]).toEqual([1.5, 2]);
    expect([...(excerpt.signals.q?.maximum ?? [])]).toEqual([5, 6]);
    expect([...(excerpt.signals.S?.minimum ?? [])]).toEqual([-1, Number.NaN]);
  });

  test("raw samples come once", () => {
    const excerpt = decodeCurves(packed(0.001, 3_600_000n, 1, [[7, 8, 9]]), ["q"]);
    expect(excerpt.raw).toBe(true);
    expect(excerpt.t[2]).toBeCloseTo(3600.002, 9);
    expect(excerpt.signals.q?.maximum).toBe(excerpt.signals.q?.minimum);
  });

  test("an answer of the wrong length is refused", () => {
    expect(() => decodeCurves(packed(0.001, 0n, 1, [[7, 8]]), ["q", "S"])).toThrow(/32 bytes, not 40/);
    expect(() => decodeCurves(new ArrayBuffer(8), ["q"])).toThrow(/24-byte header/);
  });

  test("null in JSON is a hole", () => {
    const q = { unit: "rad", minimum: [1, null], maximum: [2, null] };
    const excerpt = excerptOf({ run: 1, raw: false, width_s: 1, t: [0, 1], signals: { q } });
    expect([...(excerpt.signals.q?.maximum ?? [])]).toEqual([2, Number.NaN]);
  });
});

describe("csv", () => {
  it("gives back the columns of a file, what does not exist as no number", () => {
    const read = fromCsv("# sinew\n# t [s] t: time\nt,q,V_A\n-0.5,1e-3,nan\n0,-2,0.25\n");
    expect(Object.keys(read)).toEqual(["t", "q", "V_A"]);
    expect(Array.from(read.t ?? [])).toEqual([-0.5, 0]);
    expect(Array.from(read.q ?? [])).toEqual([0.001, -2]);
    expect(Array.from(read.V_A ?? [])).toEqual([Number.NaN, 0.25]);
  });
});

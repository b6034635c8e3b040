/** Checks that each hue of the palette has enough contrast on its theme's background, from base.css. */

import { expect, it } from "vitest";
import CSS from "./base.css?raw";
import { PALETTE, variableOf } from "./signals";

/** WCAG 2.1, 1.4.11: contrast of graphics that a reader needs. */
const LEAST = 3;
/** Contrast of curves on the dark background, which are one pixel wide when the CPU paints them. */
const LEAST_ON_DARK = 4;

function luminance(hex: string): number {
  const [r, g, b] = [1, 3, 5].map((at) => {
    const value = Number.parseInt(hex.slice(at, at + 2), 16) / 255;
    return value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
  }) as [number, number, number];
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}

function contrast(one: string, other: string): number {
  const [low, high] = [luminance(one), luminance(other)].toSorted((a, b) => a - b) as [number, number];
  return (high + 0.05) / (low + 0.05);
}

/** Distance of two colours, in steps of 255. */
function distance(one: string, other: string): number {
  const steps = [1, 3, 5].map(
    (at) => Number.parseInt(one.slice(at, at + 2), 16) - Number.parseInt(other.slice(at, at + 2), 16),
  );
  return Math.hypot(...steps);
}

function block(scheme: string): string {
  const from = CSS.indexOf(`:root[data-mantine-color-scheme="${scheme}"] {\n  --page`);
  return CSS.slice(from, CSS.indexOf("}", from));
}

function declared(name: string, within: string): string | undefined {
  return new RegExp(`${name}: (#[0-9a-f]{6});`).exec(within)?.[1];
}

it.each(PALETTE)("%s has enough contrast on the dark background and differs from the others", (hue) => {
  const dark = block("dark");
  const drawn = (of: string) => declared(variableOf(of), dark) ?? of;
  const panel = declared("--panel", dark) as string;
  expect(contrast(drawn(hue), panel)).toBeGreaterThan(LEAST_ON_DARK);
  for (const other of PALETTE)
    if (other !== hue) expect(distance(drawn(hue), drawn(other))).toBeGreaterThan(60);
});

it("does not change the hues of the light theme", () => {
  expect(CSS.slice(0, CSS.indexOf(':root[data-mantine-color-scheme="dark"]'))).not.toContain("--hue-");
  for (const hue of ["#0072B2", "#009E73", "#D55E00"])
    expect(contrast(hue, "#ffffff")).toBeGreaterThan(LEAST);
});

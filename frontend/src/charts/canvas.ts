/** Canvases in the theme's colours: the colours, and a hook that repaints after changes. */

import { useComputedColorScheme } from "@mantine/core";
import { type RefObject, useEffect, useRef } from "react";
import { paintsInSoftware } from "../drawing/canvas";
import { variableOf } from "../theme/signals";

/** Colours of everything in a chart except the curves, from the theme's CSS variables. */

export interface ChartColours {
  grid: string;
  axis: string;
  limit: string;
  text: string;
  fault: string;
  panel: string;
  accent: string;
  accentSoft: string;
  /** Returns the colour of a hue in this theme. */
  drawn(hue: string): string;
}

export function readColours(element: Element): ChartColours {
  const style = getComputedStyle(element);
  const variable = (name: string) => style.getPropertyValue(name).trim();
  const hues = new Map<string, string>(); // each query of the style would recompute it
  const drawn = (hue: string) => {
    const known = hues.get(hue) ?? (variable(variableOf(hue)) || hue);
    hues.set(hue, known);
    return known;
  };
  return {
    grid: variable("--chart-grid"),
    axis: variable("--chart-axis"),
    limit: variable("--chart-limit"),
    text: variable("--text"),
    fault: variable("--fault"),
    panel: variable("--panel"),
    accent: variable("--accent"),
    accentSoft: variable("--accent-soft"),
    drawn,
  };
}

/** Small drawing of the samples, repainted only after changes. */

const EVERY_MS = 66;

export interface Surface {
  readonly context: CanvasRenderingContext2D;
  /** Size in CSS pixels; the context is scaled accordingly and cleared. */
  readonly width: number;
  readonly height: number;
  readonly colours: ChartColours;
}

export interface Drawing {
  /** Identifies the picture: the drawing is repainted when the signature changes. */
  signature(): string;
  paint(surface: Surface): void;
}

/** Repaints `drawing` on the canvas of the returned reference, in the size of its layout. */
export function useCanvas(drawing: Drawing): RefObject<HTMLCanvasElement | null> {
  const canvas = useRef<HTMLCanvasElement>(null);
  const scheme = useComputedColorScheme("light");

  // biome-ignore lint/correctness/useExhaustiveDependencies: another colour scheme has other colours
  useEffect(() => {
    const element = canvas.current;
    const context = element?.getContext("2d", { willReadFrequently: paintsInSoftware() }) ?? null;
    if (element === null || context === null) return;
    const colours = readColours(element);
    let painted = "";
    let checked_ms = 0;
    let request = 0;
    const frame = (now_ms: number) => {
      request = requestAnimationFrame(frame);
      if (now_ms - checked_ms < EVERY_MS) return;
      checked_ms = now_ms;
      const { clientWidth: width, clientHeight: height } = element;
      const signature = `${width} ${height} ${drawing.signature()}`;
      if (signature === painted || width === 0 || height === 0) return;
      painted = signature;
      fitCanvas(element, context, width, height);
      drawing.paint({ context, width, height, colours });
    };
    request = requestAnimationFrame(frame);
    return () => cancelAnimationFrame(request);
  }, [drawing, scheme]);

  return canvas;
}

function fitCanvas(
  element: HTMLCanvasElement,
  context: CanvasRenderingContext2D,
  width: number,
  height: number,
): void {
  const ratio = window.devicePixelRatio;
  const [w, h] = [Math.round(width * ratio), Math.round(height * ratio)];
  if (element.width !== w || element.height !== h) {
    element.width = w;
    element.height = h;
  }
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
}

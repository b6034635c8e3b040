/** Canvases in the colours of the theme: the colours, and a hook that paints when something has changed. */

import { useComputedColorScheme } from "@mantine/core";
import { type RefObject, useEffect, useRef } from "react";
import { paintsInSoftware } from "../drawing/canvas";
import { variableOf } from "../theme/signals";

/** Colours of what the charts draw beside the curves, read from the theme's variables. */

export interface ChartColours {
  grid: string;
  axis: string;
  limit: string;
  text: string;
  fault: string;
  panel: string;
  accent: string;
  accentSoft: string;
  /** A hue as this theme draws it. */
  drawn(hue: string): string;
}

export function readColours(element: Element): ChartColours {
  const style = getComputedStyle(element);
  const variable = (name: string) => style.getPropertyValue(name).trim();
  const asked = new Map<string, string>(); // to ask the style anew for each frame would have it computed anew
  const drawn = (hue: string) => {
    const known = asked.get(hue) ?? (variable(variableOf(hue)) || hue);
    asked.set(hue, known);
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

/** A small drawing that follows the samples, painted only when something in it has changed. */

const EVERY_MS = 66;

export interface Surface {
  readonly context: CanvasRenderingContext2D;
  /** Size in CSS pixels; the context is scaled to them and cleared. */
  readonly width: number;
  readonly height: number;
  readonly colours: ChartColours;
}

export interface Drawing {
  /** Tells one picture from another: the drawing is painted when it changes. */
  signature(): string;
  paint(surface: Surface): void;
}

/** Keep `drawing` painted on the canvas of the returned reference, as large as the canvas is laid out. */
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
    let looked_ms = 0;
    let request = 0;
    const frame = (now_ms: number) => {
      request = requestAnimationFrame(frame);
      if (now_ms - looked_ms < EVERY_MS) return;
      looked_ms = now_ms;
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

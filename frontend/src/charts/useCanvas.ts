/** A small drawing that follows the samples, painted only when something in it has changed. */

import { useComputedColorScheme } from "@mantine/core";
import { type RefObject, useEffect, useRef } from "react";
import { paintsInSoftware } from "../drawing/canvas";
import { type ChartColours, readColours } from "./colours";

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

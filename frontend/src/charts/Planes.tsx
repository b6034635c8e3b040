/** Signals over signals, over the stretch that the charts above show. */

import { useMemo } from "react";
import { fixed } from "../samples/format";
import type { Stretch } from "../samples/stretch";
import styles from "./Charts.module.css";
import { Legend } from "./Legend";
import { type DrawnPlane, type Plane, type PlaneRanges, paintPlane, pointsOf, rangesFor } from "./plane";
import type { PlotSource } from "./source";
import { type Drawing, useCanvas } from "./useCanvas";

interface PlaneProps {
  readonly plane: Plane;
  /** Place among all panels. */
  readonly place: number;
  readonly source: PlotSource;
  readonly hidden: ReadonlySet<string>;
  seen(): Stretch;
  /** The moment that the legends tell. */
  looked(): number;
  onToggle(name: string): void;
}

export function PlaneFigure({ plane, place, source, hidden, seen, looked, onToggle }: PlaneProps) {
  const drawing = useMemo(
    () => drawingOf(plane, source, hidden, seen, looked),
    [plane, source, hidden, seen, looked],
  );
  const canvas = useCanvas(drawing);
  return (
    <figure className={styles.plane} aria-label={plane.title} data-panel={place}>
      <Legend panel={plane} hidden={hidden} onToggle={onToggle} onHighlight={() => undefined} />
      <div className={styles.planeHost} aria-hidden="true">
        <canvas ref={canvas} className={styles.planeCanvas} />
      </div>
    </figure>
  );
}

function drawingOf(
  plane: Plane,
  source: PlotSource,
  hidden: ReadonlySet<string>,
  seen: () => Stretch,
  looked: () => number,
): Drawing {
  let ranges: PlaneRanges | null = null;
  return {
    signature: () => {
      const { from_s, to_s } = seen();
      return [source.version(), from_s, to_s, looked()].map((part) => fixed(part, 3)).join(" ");
    },
    paint: (surface) => {
      const drawn = drawnNow(plane, source, hidden, seen(), looked(), ranges);
      ranges = drawn.ranges;
      paintPlane(surface, drawn);
    },
  };
}

/** What is to be drawn of a stretch. */
export function drawnNow(
  plane: Plane,
  source: PlotSource,
  hidden: ReadonlySet<string>,
  seen: Stretch,
  looked_s: number,
  before: PlaneRanges | null,
): DrawnPlane {
  const traces = plane.traces.filter(({ name }) => !hidden.has(name));
  const curves = traces.map((trace) => pointsOf(source, plane, trace, seen));
  const dots = traces.map(({ name }) => ({
    x: source.at(plane.over.name, looked_s) * plane.over.factor,
    y: source.at(name, looked_s) * plane.factor,
  }));
  return { traces, curves, dots, ranges: rangesFor(before, plane, curves) };
}

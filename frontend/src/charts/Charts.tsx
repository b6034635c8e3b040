/** A stack of charts with legends that read out values, one shared cursor and two measuring cursors. */

import { useComputedColorScheme } from "@mantine/core";
import { useElementSize } from "@mantine/hooks";
import { type ReactNode, useEffect, useMemo, useRef, useState } from "react";
import type { Panel } from "../theme/signals";
import styles from "./Charts.module.css";
import type { LimitLine, PlacedMark } from "./decorations";
import { type GestureTarget, listen, steer } from "./gestures";
import { Legend } from "./Legend";
import { Readout } from "./readout";
import type { PlotSource } from "./source";
import { ChartStack } from "./stack";
import type { ViewControl } from "./useViewport";
import { held, panned, type Viewport, zoomed } from "./viewport";

interface ChartsProps {
  readonly panels: readonly Panel[];
  readonly source: PlotSource;
  readonly control: ViewControl;
  /** Where a double click leads. */
  readonly home: Viewport;
  readonly longest_s?: number;
  readonly limits: ReadonlyMap<Panel, readonly LimitLine[]>;
  readonly marks: readonly PlacedMark[];
  readonly measuring: boolean;
  /** Values are old: shown grey. */
  readonly stale: boolean;
  /** Buttons below the charts; may hold an element with data-role="delta-t". */
  readonly children?: ReactNode;
}

export function Charts(props: ChartsProps) {
  const { panels, source, control, home, longest_s, limits, marks, measuring, stale, children } = props;
  const { change, current } = control;
  const scheme = useComputedColorScheme("light");
  const size = useElementSize();
  const hosts = useRef<(HTMLDivElement | null)[]>([]);
  const area = useRef<HTMLDivElement>(null);
  const frame = useRef<HTMLElement>(null);
  const [hidden, setHidden] = useState<ReadonlySet<string>>(new Set());
  const readout = useMemo(() => new Readout(source, panels), [source, panels]);
  const stack = useRef<ChartStack | null>(null);

  const target = useMemo<GestureTarget>(() => {
    const instant = (at: number) => {
      const seen = stack.current?.seen() ?? { from_s: 0, to_s: 0 };
      return seen.from_s + at * (seen.to_s - seen.from_s);
    };
    return {
      zoomTime: (factor, at) => change(zoomed(current.current, factor, instant(at), longest_s)),
      zoomValues: (factor, clientY) => {
        const index = hosts.current.findIndex((host) => host !== null && inside(host, clientY));
        const box = hosts.current[index]?.getBoundingClientRect();
        if (box !== undefined) stack.current?.scaleValues(index, factor, (box.bottom - clientY) / box.height);
      },
      pan: (by) => {
        const view = current.current;
        change(panned(view, -by * view.span_s, source.first_s(), source.now_s()));
      },
      reset: () => {
        stack.current?.resetValues();
        change(home);
      },
      hover: (at) => readout.hover(at),
      grab: (at) => readout.grab(instant(at), current.current.span_s),
      move: (cursor, at) => readout.move(cursor, instant(at)),
    };
  }, [source, readout, change, current, home, longest_s]);

  // biome-ignore lint/correctness/useExhaustiveDependencies: a new colour scheme needs new colours on the canvases
  useEffect(() => {
    const elements = hosts.current.filter((host) => host !== null);
    const built = new ChartStack(
      elements,
      panels,
      source,
      () => current.current,
      (seen) => readout.refresh(seen),
    );
    stack.current = built;
    return () => {
      stack.current = null;
      built.destroy();
    };
  }, [panels, source, current, readout, scheme]);

  // biome-ignore lint/correctness/useExhaustiveDependencies: the size is the reason to measure again
  useEffect(() => stack.current?.resize(), [size.width, size.height]);

  // biome-ignore lint/correctness/useExhaustiveDependencies: a rebuilt stack needs everything again
  useEffect(() => {
    stack.current?.setLimits(limits);
    stack.current?.setMarks(marks);
    for (const panel of panels) {
      for (const trace of panel.traces) stack.current?.show(trace.name, !hidden.has(trace.name));
    }
  }, [limits, marks, hidden, panels, source, scheme]);

  useEffect(() => (area.current === null ? undefined : listen(area.current, target)), [target]);
  useEffect(() => readout.attach(frame.current), [readout]);

  useEffect(() => {
    if (measuring) {
      change(held(current.current, source.now_s()));
      const seen = stack.current?.seen();
      if (seen !== undefined) readout.measure(seen);
    } else {
      readout.stopMeasuring();
    }
  }, [measuring, readout, source, change, current]);

  function toggle(name: string): void {
    const next = new Set(hidden);
    if (!next.delete(name)) next.add(name);
    setHidden(next);
  }

  return (
    <section
      ref={frame}
      className={styles.stack}
      data-stale={stale}
      data-measuring={measuring}
      aria-label="Charts"
    >
      <div ref={size.ref} className={styles.body}>
        {panels.map((panel, index) => (
          <figure
            key={panel.title}
            className={styles.panel}
            aria-label={panel.title}
            data-last={index === panels.length - 1}
            // biome-ignore lint/a11y/noNoninteractiveTabindex: arrow keys pan and zoom the chart that has the focus
            tabIndex={0}
            onKeyDown={(event) => {
              if (event.target === event.currentTarget && steer(event.key, target)) event.preventDefault();
            }}
          >
            <Legend panel={panel} hidden={hidden} onToggle={toggle} />
            <div
              className={styles.host}
              ref={(element) => {
                hosts.current[index] = element;
              }}
            />
          </figure>
        ))}
        <div ref={area} className={styles.area}>
          <div className={styles.cursor} data-role="hover" />
          <div className={styles.measure} data-role="cursor-0" />
          <div className={styles.measure} data-role="cursor-1" />
        </div>
      </div>
      {children}
    </section>
  );
}

function inside(element: HTMLElement, clientY: number): boolean {
  const box = element.getBoundingClientRect();
  return clientY >= box.top && clientY <= box.bottom;
}

/** Position and stiffness in one plane: what may be asked for, where the joint is and was; a click sets both references. */

import { useElementSize } from "@mantine/hooks";
import { useEffect, useMemo, useRef } from "react";
import { Card } from "../../components/Card";
import { Refusal } from "../../components/Refusal";
import { useLive, useLiveStore } from "../../live/react";
import type { SampleWindow } from "../../samples/window";
import { useSetReferences } from "../../service/commands";
import { DEGREES } from "../../theme/signals";
import styles from "./MapCard.module.css";
import { type Plane, planeOver, pointAt, xOf, yOf } from "./planeScale";

const EVERY_MS = 66;
const TRAIL_TICKS = 4000;
const TRAIL_STEP = 50;
const Q_GRID_DEG = [-60, -30, 0, 30, 60];
const S_GRID = [8, 10, 12, 14];

export function MapCard() {
  const store = useLiveStore();
  const limits = useLive((live) => live.state?.limits);
  const references = useLive((live) => live.state?.references);
  const size = useElementSize();
  const drawing = useRef<SVGSVGElement>(null);
  const send = useSetReferences();
  const plane = useMemo(
    () => (limits && size.width > 0 ? planeOver(limits, size.width, size.height) : null),
    [limits, size.width, size.height],
  );

  useEffect(() => {
    if (plane === null) return;
    let request = 0;
    let drawn_ms = 0;
    const frame = (now_ms: number) => {
      request = requestAnimationFrame(frame);
      if (now_ms - drawn_ms < EVERY_MS || drawing.current === null) return;
      drawn_ms = now_ms;
      drawTrail(drawing.current, plane, store.window);
    };
    request = requestAnimationFrame(frame);
    return () => cancelAnimationFrame(request);
  }, [store, plane]);

  function aim(event: React.MouseEvent<SVGSVGElement>): void {
    if (plane === null) return;
    const box = event.currentTarget.getBoundingClientRect();
    const { q, S } = pointAt(plane, event.clientX - box.left, event.clientY - box.top);
    send.mutate({ q_ref: q, S_ref: S });
  }

  return (
    <Card title="Reachable map" className={styles.card}>
      <div ref={size.ref} className={styles.host}>
        {plane !== null && limits && (
          // biome-ignore lint/a11y/useKeyWithClickEvents: the reference sliders do the same by keyboard
          <svg
            ref={drawing}
            className={styles.map}
            width={plane.width}
            height={plane.height}
            role="img"
            aria-label="Reachable map"
            onClick={aim}
          >
            <rect
              className={styles.region}
              x={xOf(plane, limits.q_min)}
              y={yOf(plane, limits.S_max)}
              width={xOf(plane, limits.q_max) - xOf(plane, limits.q_min)}
              height={yOf(plane, limits.S_min) - yOf(plane, limits.S_max)}
            />
            <Grid plane={plane} />
            <polyline data-part="trail" className={styles.trail} />
            {references && (
              <path
                className={styles.target}
                d="M-7 0H7M0 -7V7"
                transform={`translate(${xOf(plane, references.q_ref)} ${yOf(plane, references.S_ref)})`}
              />
            )}
            <circle data-part="joint" r="5" className={styles.joint} />
          </svg>
        )}
      </div>
      <Refusal text={send.error?.message} hint="Click sets q_ref and S_ref together." />
    </Card>
  );
}

function Grid({ plane }: { plane: Plane }) {
  const floor = plane.height - plane.bottom;
  return (
    <g className={styles.grid}>
      {Q_GRID_DEG.map((q) => {
        const x = xOf(plane, q / DEGREES);
        return (
          <g key={q}>
            <line x1={x} x2={x} y1={8} y2={floor} />
            <text x={x} y={floor + 14} textAnchor="middle">
              {q}°
            </text>
          </g>
        );
      })}
      {S_GRID.map((S) => {
        const y = yOf(plane, S);
        return (
          <g key={S}>
            <line x1={plane.left} x2={plane.width - 8} y1={y} y2={y} />
            <text x={plane.left - 6} y={y + 4} textAnchor="end">
              {S}
            </text>
          </g>
        );
      })}
    </g>
  );
}

function drawTrail(svg: SVGSVGElement, plane: Plane, window: SampleWindow): void {
  const points: string[] = [];
  const from = Math.max(window.startTick, window.endTick - TRAIL_TICKS);
  for (let tick = from - (from % TRAIL_STEP) + TRAIL_STEP; tick < window.endTick; tick += TRAIL_STEP) {
    push(points, plane, window.at("q", tick), window.at("S", tick));
  }
  push(points, plane, window.newest("q"), window.newest("S"));
  svg.querySelector('[data-part="trail"]')?.setAttribute("points", points.join(" "));
  const joint = svg.querySelector('[data-part="joint"]');
  const last = points.at(-1)?.split(",");
  joint?.setAttribute("cx", last?.[0] ?? "-20");
  joint?.setAttribute("cy", last?.[1] ?? "-20");
}

function push(points: string[], plane: Plane, q: number, S: number): void {
  if (Number.isFinite(q) && Number.isFinite(S))
    points.push(`${xOf(plane, q).toFixed(1)},${yOf(plane, S).toFixed(1)}`);
}

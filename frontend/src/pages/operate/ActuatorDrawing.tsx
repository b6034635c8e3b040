/** The actuator drawn flat and live: cheap enough for any machine. */

import { useEffect, useRef } from "react";
import { useLiveStore } from "../../live/react";
import { fixed } from "../../samples/format";
import { HUES } from "../../theme/signals";
import styles from "./ActuatorDrawing.module.css";
import { actuatorPose, fanPath, type Side, type Signals } from "./actuatorPose";

const EVERY_MS = 66;
const NAMES = ["q", "q_ref", "S", "theta_A", "theta_B", "F_A", "F_B"] as const;
const LINK = 84;
const PULLEY = 46;
const TENDON_TOP = 130;
const SPRING_TOP = 196;

export function ActuatorDrawing() {
  const store = useLiveStore();
  const drawing = useRef<SVGSVGElement>(null);

  useEffect(() => {
    let request = 0;
    let drawn_ms = 0;
    const frame = (now_ms: number) => {
      request = requestAnimationFrame(frame);
      if (now_ms - drawn_ms < EVERY_MS || drawing.current === null) return;
      drawn_ms = now_ms;
      const signals = Object.fromEntries(
        NAMES.map((name) => [name, store.window.newest(name)]),
      ) as unknown as Signals;
      draw(drawing.current, signals, store.snapshot().state?.limits.F_min ?? 0);
    };
    request = requestAnimationFrame(frame);
    return () => cancelAnimationFrame(request);
  }, [store]);

  return (
    <svg ref={drawing} viewBox="0 0 240 330" className={styles.drawing} role="img" aria-label="Actuator">
      <g transform={`translate(120 ${TENDON_TOP})`}>
        <g data-part="ghost" className={styles.ghost}>
          <line y2={-LINK - 10} />
        </g>
        <g data-part="link">
          <path data-part="fan" className={styles.fan} />
          <line y2={-LINK} className={styles.link} />
          <circle r={PULLEY} className={styles.pulley} />
          <line y1={-PULLEY + 8} y2={-PULLEY} className={styles.pulleyMark} />
        </g>
        <circle r="5" className={styles.axis} />
      </g>
      <Tendon name="A" x={120 - PULLEY} hue={HUES.F_A} />
      <Tendon name="B" x={120 + PULLEY} hue={HUES.F_B} />
      <text x="120" y="18" textAnchor="middle" data-part="text-q" className={styles.figure} />
      <text x="120" y="326" textAnchor="middle" data-part="text-S" className={styles.figure} />
    </svg>
  );
}

function Tendon({ name, x, hue }: { name: "A" | "B"; x: number; hue: string }) {
  const outward = name === "A" ? -1 : 1;
  return (
    <g transform={`translate(${x} 0)`}>
      <line
        y1={TENDON_TOP}
        y2={SPRING_TOP}
        stroke={hue}
        data-part={`tendon-${name}`}
        className={styles.tendon}
      />
      <line x1="-13" x2="13" y1={SPRING_TOP} y2={SPRING_TOP} className={styles.seat} />
      <g transform={`translate(0 ${SPRING_TOP})`}>
        <path data-part={`spring-${name}`} className={styles.spring} />
        <g data-part={`carriage-${name}`}>
          <line x1="-13" x2="13" className={styles.seat} />
          <g transform="translate(0 16)">
            <circle r="13" className={styles.reel} />
            <line y2="-13" data-part={`reel-${name}`} className={styles.reelMark} />
          </g>
        </g>
      </g>
      <text
        x={outward * 18}
        y={SPRING_TOP - 30}
        textAnchor={name === "A" ? "end" : "start"}
        data-part={`text-${name}`}
        className={styles.label}
      />
    </g>
  );
}

function draw(svg: SVGSVGElement, signals: Signals, slack_N: number): void {
  const part = (name: string) => svg.querySelector(`[data-part="${name}"]`);
  const pose = actuatorPose(signals, slack_N);
  part("link")?.setAttribute("transform", `rotate(${pose.link_deg.toFixed(2)})`);
  part("ghost")?.setAttribute("transform", `rotate(${pose.ghost_deg.toFixed(2)})`);
  part("fan")?.setAttribute("d", fanPath(pose.fan_deg, LINK + 10));
  for (const name of ["A", "B"] as const) drawSide(part, name, pose[name], signals[`F_${name}`]);
  write(part("text-q"), `q ${fixed((signals.q * 180) / Math.PI, 1)}°`);
  write(part("text-S"), `S ${fixed(signals.S, 2)} N·m/rad`);
}

function drawSide(
  part: (name: string) => Element | null,
  name: "A" | "B",
  side: Side,
  force_N: number,
): void {
  const tendon = part(`tendon-${name}`);
  tendon?.setAttribute("stroke-width", side.tendon.toFixed(2));
  tendon?.setAttribute("stroke-dasharray", side.slack ? "3 4" : "none");
  part(`spring-${name}`)?.setAttribute("d", side.spring);
  part(`carriage-${name}`)?.setAttribute("transform", `translate(0 ${side.springLength.toFixed(1)})`);
  part(`reel-${name}`)?.setAttribute("transform", `rotate(${side.reel_deg.toFixed(1)})`);
  write(part(`text-${name}`), side.slack ? "slack" : `${fixed(force_N, 1)} N`);
}

function write(element: Element | null, text: string): void {
  if (element !== null && element.textContent !== text) element.textContent = text;
}

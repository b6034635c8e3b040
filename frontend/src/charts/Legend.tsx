/** Head of a chart: what it shows, in which unit, and a switch with the value of each signal. */

import { SignalName } from "../components/SignalName";
import type { Panel, Trace } from "../theme/signals";
import styles from "./Charts.module.css";

interface LegendProps {
  readonly panel: Panel;
  readonly hidden: ReadonlySet<string>;
  readonly onToggle: (name: string) => void;
}

export function Legend({ panel, hidden, onToggle }: LegendProps) {
  return (
    <figcaption className={styles.caption}>
      <span className={styles.title}>
        {panel.title} <span className={styles.unit}>[{panel.unit}]</span>
      </span>
      {panel.traces.map((trace) => (
        <button
          key={trace.name}
          type="button"
          className={styles.toggle}
          aria-pressed={!hidden.has(trace.name)}
          aria-label={trace.name}
          title={hidden.has(trace.name) ? "Show" : "Hide"}
          onClick={() => onToggle(trace.name)}
        >
          <Swatch trace={trace} />
          <SignalName name={trace.name} />
          <span className={styles.value} data-role={`value-${trace.name}`}>
            –
          </span>
          <span className={styles.delta} data-role={`delta-${trace.name}`} />
        </button>
      ))}
    </figcaption>
  );
}

function Swatch({ trace }: { trace: Trace }) {
  return (
    <svg width="18" height="8" aria-hidden="true">
      <line
        x1="0"
        x2="18"
        y1="4"
        y2="4"
        stroke={trace.hue}
        strokeWidth="2.5"
        strokeDasharray={trace.dashed ? "5 3" : undefined}
      />
    </svg>
  );
}

/** Head of a chart: what it shows, in which unit, and a switch with the value of each signal. */

import { TbArrowsMaximize, TbArrowsMinimize } from "react-icons/tb";
import { Explained, entriesOf, explaining } from "../components/Explained";
import { Written } from "../components/SignalName";
import { symbolEntries } from "../service/glossary";
import type { Panel } from "../theme/signals";
import styles from "./Charts.module.css";
import { ColourChoice } from "./ColourChoice";
import { TraceLine } from "./TraceLine";

/** While it is measured: the values at the cursors and their difference, in place of the one value. */
const CURSORS = ["cursor-0", "cursor-1", "delta"] as const;

interface LegendProps {
  readonly panel: Panel;
  readonly hidden: ReadonlySet<string>;
  readonly onToggle: (name: string) => void;
  /** Pointed at or focused; null when left. */
  readonly onHighlight: (name: string | null) => void;
  /** Whether this panel is the only one shown; left out where it cannot be. */
  readonly enlarged?: boolean;
  readonly onEnlarge?: () => void;
}

export function Legend({ panel, hidden, onToggle, onHighlight, enlarged, onEnlarge }: LegendProps) {
  return (
    <figcaption className={styles.caption}>
      <span className={styles.title}>
        <Explained of={panel.traces.flatMap(({ name }) => symbolEntries(name))}>{panel.title}</Explained>{" "}
        {panel.unit !== "1" && <span className={styles.unit}>[{panel.unit}]</span>}
      </span>
      {onEnlarge !== undefined && (
        <button
          type="button"
          className={styles.enlarge}
          aria-label={`Enlarge ${panel.title}`}
          aria-pressed={enlarged === true}
          title={enlarged ? "Show all panels (Esc)" : "Show this panel alone; Esc shows all"}
          onClick={onEnlarge}
        >
          {enlarged ? <TbArrowsMinimize size={15} /> : <TbArrowsMaximize size={15} />}
        </button>
      )}
      {panel.traces.map((trace) => (
        <span
          key={trace.name}
          className={styles.entry}
          onPointerEnter={() => onHighlight(trace.name)}
          onPointerLeave={() => onHighlight(null)}
        >
          {trace.ofRecording ? <TraceLine trace={trace} /> : <ColourChoice trace={trace} />}
          <button
            type="button"
            className={styles.toggle}
            aria-pressed={!hidden.has(trace.name)}
            onClick={() => onToggle(trace.name)}
            {...explaining(entriesOf(symbolEntries(trace.name)))}
          >
            <span aria-hidden="true">
              <Written name={trace.name} />
            </span>
            <span className="visually-hidden">{trace.name}</span>
          </button>
          <span className={styles.value} data-role={`value-${trace.name}`} />
          {CURSORS.map((role) => (
            <span key={role} className={styles.delta} data-role={`${role}-${trace.name}`} />
          ))}
        </span>
      ))}
      {panel.over !== undefined && (
        <span className={styles.over}>
          over <Written name={panel.over.name} />
          {panel.over.unit !== "1" && <span>[{panel.over.unit}]</span>}
          <span className={styles.value} data-role="over" />
        </span>
      )}
    </figcaption>
  );
}

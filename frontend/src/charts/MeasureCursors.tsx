/** The line under the pointer, and the two measuring cursors, moved by mouse or arrow keys. */

import styles from "./Charts.module.css";
import type { Readout } from "./readout";

interface MeasureCursorsProps {
  readonly readout: Readout;
  readonly measuring: boolean;
  span_s(): number;
}

export function MeasureCursors({ readout, measuring, span_s }: MeasureCursorsProps) {
  return (
    <>
      <div className={styles.cursor} data-role="hover" aria-hidden="true">
        <span className={styles.lineTime} data-role="hover-time" />
        <span className={styles.lineMarks} data-role="marks" hidden />
      </div>
      {([0, 1] as const).map((cursor) => (
        <div
          key={cursor}
          className={styles.measure}
          data-role={`cursor-${cursor}`}
          role="slider"
          aria-label={`Measuring cursor ${cursor + 1} [s]`}
          aria-valuenow={0}
          tabIndex={measuring ? 0 : -1}
          onKeyDown={(event) => {
            const by = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
            if (by === undefined) return;
            event.preventDefault();
            const share = event.shiftKey ? 0.1 : 0.005;
            readout.nudge(cursor, by * share, span_s());
          }}
        >
          <span className={styles.lineTime} data-role={`cursor-${cursor}-time`} aria-hidden="true" />
        </div>
      ))}
    </>
  );
}

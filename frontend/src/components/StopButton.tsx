/** STOP. Always enabled, one action, no question. */

import { useStop } from "../service/StopProvider";
import styles from "./StopButton.module.css";

export function StopButton() {
  const { state, stop } = useStop();
  return (
    <button
      type="button"
      className={styles.stop}
      data-sending={state.kind === "sending"}
      aria-label="STOP"
      aria-keyshortcuts="Control+Shift+E Meta+Shift+E"
      title="Hard stop: zero volts at once, latched (Ctrl/Cmd+Shift+E)"
      onPointerDown={(event) => {
        if (event.button === 0) stop();
      }}
      onClick={(event) => {
        // detail 0: pressed by the keyboard or an assistive device, which sends no pointer event
        if (event.detail === 0) stop();
      }}
    >
      <span className={styles.square} aria-hidden="true" />
      STOP
    </button>
  );
}

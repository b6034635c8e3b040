/** What became of STOP: from the answer to the press until the service tells it itself, and then as the service tells it. */

import { useEffect } from "react";
import { useLive } from "../live/react";
import { useStop } from "../service/StopProvider";
import styles from "./StatusStrip.module.css";
import { stopSentence } from "./status";

export function StopResult() {
  const state = useLive((live) => live.state);
  const { state: stop, heard } = useStop();
  useEffect(() => {
    if (state !== null) heard(state);
  }, [state, heard]);
  return (
    <output className={styles.proof} aria-label="Stop result" data-kind={stop.kind}>
      {stopSentence(stop, state)}
    </output>
  );
}

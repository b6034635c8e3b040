/** What became of STOP: from the answer to the press until the service tells it itself, and then as the service tells it. */

import { useEffect } from "react";
import { useLive } from "../live/react";
import { useStop } from "../service/useStop";
import { hearState, showElsewhere } from "../stop/stop";
import styles from "./StatusStrip.module.css";
import { stopSentence } from "./status";

export function StopResult() {
  const state = useLive((live) => live.state);
  const stop = useStop();
  useEffect(() => showElsewhere(), []);
  useEffect(() => {
    if (state !== null) hearState(state);
  }, [state]);
  return (
    <output className={styles.proof} aria-label="Stop result" data-kind={stop.kind}>
      {stopSentence(stop, state)}
    </output>
  );
}

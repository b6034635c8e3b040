/** Says that this page has lost control, until it has control again or a person has read it. */

import { Button } from "@mantine/core";
import { useEffect, useState } from "react";
import { TbAlertTriangle } from "react-icons/tb";
import { useLive } from "../live/react";
import { afterTold, lossSentence, NO_CONTROL } from "../service/controlLoss";
import { givenUpEpoch, heldEpoch } from "../wire/control";
import styles from "./ControlLoss.module.css";
import { TakeControl } from "./TakeControl";

export function ControlLoss() {
  const state = useLive((live) => live.state);
  const [kept, keep] = useState(NO_CONTROL);
  useEffect(() => {
    if (state === null) return;
    const handed = state.wishes.some(({ epoch }) => epoch !== null && epoch === state.holder?.epoch);
    keep((before) => {
      const givenUp = handed ? before.had : givenUpEpoch();
      return afterTold(before, state.holder, heldEpoch(), givenUp, Date.now());
    });
  }, [state]);
  if (kept.lost === null) return null;
  const at = new Date(kept.lost.at_ms).toLocaleTimeString("sv-SE");
  return (
    <div className={styles.loss} role="alert" aria-label="Control lost">
      <TbAlertTriangle size={18} aria-hidden="true" />
      <span className={styles.message}>
        <strong>{at}</strong> {lossSentence(kept.lost)}
      </span>
      <TakeControl variant="white" color="dark" />
      <Button size="compact-xs" variant="subtle" color="dark" onClick={() => keep(NO_CONTROL)}>
        Stay an observer
      </Button>
    </div>
  );
}

/** How a run ended, in words and with an icon. */

import {
  IconCheck,
  IconHandStop,
  IconPlayerRecord,
  IconPlugConnectedX,
  IconSkull,
  IconUrgent,
} from "@tabler/icons-react";
import styles from "./RunState.module.css";

const STATES: Record<string, { text: string; Icon: typeof IconCheck; abnormal: boolean }> = {
  running: { text: "running", Icon: IconPlayerRecord, abnormal: false },
  completed: { text: "completed", Icon: IconCheck, abnormal: false },
  stopped: { text: "stopped", Icon: IconHandStop, abnormal: false },
  tripped: { text: "tripped", Icon: IconUrgent, abnormal: true },
  link_lost: { text: "link lost", Icon: IconPlugConnectedX, abnormal: true },
  service_died: { text: "service died", Icon: IconSkull, abnormal: true },
};

export function RunState({ state, reason = "" }: { state: string; reason?: string }) {
  const known = STATES[state];
  const Icon = known?.Icon ?? IconUrgent;
  return (
    <span className={styles.state} data-abnormal={known?.abnormal ?? true} data-state={state} title={reason}>
      <Icon size={15} aria-hidden="true" />
      {known?.text ?? state.replaceAll("_", " ")}
    </span>
  );
}

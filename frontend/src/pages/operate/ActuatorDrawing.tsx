/** The actuator drawn flat and live: cheap enough for any machine. */

import { useMemo } from "react";
import { useCanvas } from "../../charts/useCanvas";
import { useLiveStore } from "../../live/react";
import styles from "./ActuatorDrawing.module.css";
import { actuatorPose, type Signals } from "./actuatorPose";
import { paintActuator } from "./paintActuator";

const NAMES = ["q", "q_ref", "S", "theta_A", "theta_B", "F_A", "F_B"] as const;

export function ActuatorDrawing() {
  const store = useLiveStore();
  const drawing = useMemo(() => {
    const read = () =>
      Object.fromEntries(NAMES.map((name) => [name, store.window.newest(name)])) as unknown as Signals;
    return {
      signature: () =>
        NAMES.map((name) => store.window.newest(name).toFixed(name.startsWith("F") ? 1 : 2)).join(),
      paint: (surface: Parameters<typeof paintActuator>[0]) => {
        const signals = read();
        paintActuator(surface, signals, actuatorPose(signals, store.snapshot().state?.limits.F_min ?? 0));
      },
    };
  }, [store]);
  const canvas = useCanvas(drawing);
  return <canvas ref={canvas} className={styles.drawing} role="img" aria-label="Actuator" />;
}

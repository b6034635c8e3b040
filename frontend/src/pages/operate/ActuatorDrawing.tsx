/** The actuator drawn flat: cheap enough for any machine. Live, or as a recording has it at a moment. */

import { useMemo } from "react";
import { useCanvas } from "../../charts/useCanvas";
import { useLiveStore, useSampleAge } from "../../live/react";
import { age } from "../../samples/format";
import { useAngles } from "../../service/angles";
import styles from "./ActuatorDrawing.module.css";
import { actuatorPose, type Signals } from "./actuatorPose";
import { paintActuator } from "./paintActuator";

const NAMES = ["q", "q_ref", "S", "theta_A", "theta_B", "F_A", "F_B"] as const;

/** `read` gives a signal at present; the same function as long as it is the same recording. */
export function ActuatorDrawing({ read }: { read?: (name: string) => number }) {
  const store = useLiveStore();
  const angles = useAngles();
  const drawing = useMemo(() => {
    const value = read ?? ((name: string) => store.window.newest(name));
    const signals = () => Object.fromEntries(NAMES.map((name) => [name, value(name)])) as unknown as Signals;
    return {
      signature: () => NAMES.map((name) => value(name).toFixed(name.startsWith("F") ? 1 : 2)).join() + angles,
      paint: (surface: Parameters<typeof paintActuator>[0]) => {
        const seen = signals();
        const pose = actuatorPose(seen, store.snapshot().state?.limits.F_min ?? 0);
        paintActuator(surface, seen, pose, angles);
      },
    };
  }, [store, read, angles]);
  const canvas = useCanvas(drawing);
  const old_s = useSampleAge();
  const stale = read === undefined && old_s !== null;
  return (
    <canvas
      ref={canvas}
      className={styles.drawing}
      data-stale={stale}
      role="img"
      aria-label={stale ? `Actuator, ${age(1000 * old_s)} ago` : "Actuator"}
    />
  );
}

/** Whether the drives are on, and their switch: after hands were at the rig they stay off until somebody says otherwise. */

import { Button } from "@mantine/core";
import { TbHandStop, TbPlugConnected } from "react-icons/tb";
import { OperatorsOnly } from "../../components/OperatorsOnly";
import { Refusal } from "../../components/Refusal";
import { dateTime } from "../../samples/format";
import { useStepCommand } from "../../service/bringUp";
import type { BringUp } from "../../wire/types";
import styles from "./BringUp.module.css";

interface DrivesProps {
  /** How the line is at this moment. */
  readonly on: boolean;
  /** Whether the loop keeps them off; without it a reset brings back what a watchdog or a fault took away. */
  readonly locked: boolean;
  /** Who left them off before this service was started, where nobody has switched them since. */
  readonly left: BringUp["drives_left"];
  /** While a step is under way the drives are the step's. */
  readonly stepUnderWay: boolean;
}

export function Drives({ on, locked, left, stepUnderWay }: DrivesProps) {
  const command = useStepCommand();
  const switchOn = locked && !on;
  const Icon = on ? TbPlugConnected : TbHandStop;
  return (
    <section className={styles.drives} aria-label="Drives" data-on={on}>
      <Icon size={19} aria-hidden="true" />
      <p>
        <strong>{on ? "Drives on." : "Drives off."}</strong>{" "}
        {!on &&
          left !== null &&
          `${left.who} left them so on ${dateTime(left.at)}, and the service was started since: hands may still be at the rig. `}
        {on ? ON : locked ? LOCKED : UNTIL_RESET}
      </p>
      {!stepUnderWay && (
        <OperatorsOnly>
          <Button
            className={styles.switch}
            size="sm"
            variant="default"
            loading={command.isPending}
            onClick={() => command.mutate({ do: "switch-drives", on: switchOn })}
          >
            {switchOn ? "Switch drives on" : "Switch drives off"}
          </Button>
        </OperatorsOnly>
      )}
      <Refusal error={command.error} about={[on, locked, stepUnderWay]} />
    </section>
  );
}

const ON = "Keep your hands off the rig, or switch them off before you reach in.";
const LOCKED =
  "The motors can be turned by hand, and nothing starts. Take your hands off before they come on.";
const UNTIL_RESET = "They come back with the reset. After it, switch them off before you reach in.";

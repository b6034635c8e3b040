/** Who holds control, and taking it: one press where nobody holds it, an explicit choice where somebody does. */

import { Button, Menu } from "@mantine/core";
import { IconDeviceGamepad2 } from "@tabler/icons-react";
import { useMutation } from "@tanstack/react-query";
import { useSyncExternalStore } from "react";
import { useLive } from "../live/react";
import { useStanding } from "../service/useStanding";
import { answeredBy } from "../wire/client";
import { giveUpControl, heldEpoch, takeControl, watchHeld } from "../wire/control";
import { OperatorsOnly } from "./OperatorsOnly";

const NOBODY: readonly string[] = [];

export function ControlMenu() {
  const holder = useLive((live) => live.state?.holder ?? null);
  const take = useMutation({ mutationFn: (takeOver: boolean) => answeredBy(takeControl(takeOver)) });
  const giveUp = useMutation({ mutationFn: () => answeredBy(giveUpControl()) });
  const people = useLive((live) => live.state?.people ?? NOBODY);
  const epoch = useSyncExternalStore(watchHeld, heldEpoch);
  const mine = holder !== null && holder.epoch === epoch;
  const name = holder === null ? "nobody" : mine ? "you" : holder.name;
  const refusal = useStanding(take.error ?? giveUp.error)?.message;
  return (
    <Menu position="bottom-end" width={240}>
      <Menu.Target>
        <Button
          size="compact-sm"
          variant={mine ? "light" : "subtle"}
          color={mine ? undefined : "gray"}
          leftSection={<IconDeviceGamepad2 size={16} aria-hidden="true" />}
          title={refusal ?? `Control: ${name}${holder?.lost ? ", not heard" : ""}`}
          aria-label={`Control: ${name}`}
          styles={{ label: { maxWidth: "10ch", minWidth: "7ch" } }}
        >
          {name}
        </Button>
      </Menu.Target>
      <Menu.Dropdown>
        <OperatorsOnly>
          {mine ? (
            <Menu.Item onClick={() => giveUp.mutate()}>Give up control</Menu.Item>
          ) : (
            <Menu.Item onClick={() => take.mutate(holder !== null)}>
              {holder === null ? "Take control" : `Take over from ${holder.name}`}
            </Menu.Item>
          )}
        </OperatorsOnly>
        <Menu.Label>Anyone may press STOP</Menu.Label>
        {people.length > 0 && <Menu.Label>Connected: {people.join(", ")}</Menu.Label>}
      </Menu.Dropdown>
    </Menu>
  );
}

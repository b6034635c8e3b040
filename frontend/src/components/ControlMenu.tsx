/** Who holds control, and taking it; who is connected; the own name, and signing out. */

import { Button, Menu } from "@mantine/core";
import { useMutation, useQuery } from "@tanstack/react-query";
import { useSyncExternalStore } from "react";
import { TbDeviceGamepad2 } from "react-icons/tb";
import { useLive } from "../live/react";
import { timeOfDay } from "../samples/format";
import { counted } from "../samples/words";
import { useSignOut } from "../service/commands";
import { type ControlForm, isAsked, othersToGetControl } from "../service/handOver";
import { sessionQuery } from "../service/queries";
import { useErrorLifetime } from "../service/useErrorLifetime";
import { answeredBy } from "../wire/client";
import { giveUpControl, heldEpoch, takeControl, watchHeld } from "../wire/control";
import type { State } from "../wire/types";
import styles from "./ControlMenu.module.css";
import { OperatorsOnly } from "./OperatorsOnly";

const NOBODY: State["people"] = [];
const NO_WISHES: State["wishes"] = [];

interface ControlMenuProps {
  onName(): void;
  onForm(form: ControlForm): void;
}

export function ControlMenu({ onName, onForm }: ControlMenuProps) {
  const holder = useLive((live) => live.state?.holder ?? null);
  const take = useMutation({ mutationFn: (takeOver: boolean) => answeredBy(takeControl(takeOver)) });
  const giveUp = useMutation({ mutationFn: () => answeredBy(giveUpControl()) });
  const people = useLive((live) => live.state?.people ?? NOBODY);
  const me = useQuery(sessionQuery).data;
  const signOut = useSignOut();
  const epoch = useSyncExternalStore(watchHeld, heldEpoch);
  const mine = holder !== null && holder.epoch === epoch;
  const name = holder === null ? "nobody" : mine ? "you" : holder.name;
  const asking = useLive((live) => live.state?.wishes ?? NO_WISHES).filter(isAsked);
  const others = othersToGetControl(people, me?.name);
  const refusal = useErrorLifetime(take.error ?? giveUp.error ?? signOut.error)?.message;
  return (
    <Menu position="bottom-end" width={300} withInitialFocusPlaceholder={false}>
      <Menu.Target>
        <Button
          size="compact-sm"
          variant={mine ? "light" : "subtle"}
          color={mine ? undefined : "gray"}
          leftSection={<TbDeviceGamepad2 size={16} aria-hidden="true" />}
          title={
            refusal ??
            `Control: ${name}${holder?.lost ? ", not heard" : ""}. Here is also who is connected, and Sign out`
          }
          aria-label={`Control: ${name}`}
          styles={{ label: { maxWidth: "10ch", minWidth: "7ch" } }}
        >
          {name}
        </Button>
      </Menu.Target>
      <Menu.Dropdown>
        <OperatorsOnly>
          {mine ? (
            <>
              {asking.map(({ number, name }) => (
                <Menu.Item key={number} onClick={() => onForm({ kind: "answer", number })}>
                  Answer {name} …
                </Menu.Item>
              ))}
              {others.length > 0 && (
                <Menu.Item onClick={() => onForm({ kind: "offer" })}>Hand over …</Menu.Item>
              )}
              <Menu.Item onClick={() => giveUp.mutate()}>Give up control</Menu.Item>
            </>
          ) : (
            <>
              {holder?.page && holder.name !== me?.name && !asking.some((one) => one.name === me?.name) && (
                <Menu.Item onClick={() => onForm({ kind: "ask" })}>Ask {holder.name} for control …</Menu.Item>
              )}
              <Menu.Item onClick={() => take.mutate(holder !== null)}>
                {holder === null ? "Take control" : `Take over from ${holder.name}`}
              </Menu.Item>
            </>
          )}
        </OperatorsOnly>
        <Menu.Label>Anyone may press STOP</Menu.Label>
        <Menu.Divider />
        <Menu.Label>Connected</Menu.Label>
        {/* biome-ignore lint/a11y/useSemanticElements: a menu holds items only; these can be read and do nothing */}
        <div role="group" className={styles.people} aria-label="Connected">
          {people.map((person) => (
            <div role="menuitem" aria-disabled tabIndex={-1} key={`${person.name} ${person.role}`}>
              <span>
                {person.name}
                {person.name === me?.name && ", you"}
              </span>
              <span className={styles.what}>
                {whatOf(person, holder?.name ?? null)},{" "}
                <span className={styles.since}>since {timeOfDay(person.since)}</span>
              </span>
            </div>
          ))}
        </div>
        <Menu.Divider />
        <Menu.Item onClick={onName}>Change name</Menu.Item>
        <Menu.Item onClick={() => signOut.mutate()}>Sign out</Menu.Item>
      </Menu.Dropdown>
    </Menu>
  );
}

/** What somebody who is connected may do and does. */
function whatOf({ name, role, pages }: State["people"][number], holder: string | null): string {
  const part = role === "viewer" ? "VIEW" : name === holder ? "has control" : "may take control";
  return `${part}, ${counted(pages, "page")}`;
}

import { Button, Kbd, Modal, Table } from "@mantine/core";
import type { FormEvent } from "react";
import { Link } from "wouter";
import { fillText } from "../samples/texts";
import { usePreferences } from "../service/api/preferences";
import { closeExplanation, type Entry } from "../service/glossary";
import { explaining, type Handlers } from "./Explained";
import { usePages } from "./Navigation";
import { TEXTS } from "./texts";

/** List of the keyboard shortcuts. */

type Keys = readonly (readonly [string[], string])[];

const STOP: Keys = [[["Ctrl/⌘", "Shift", "E"], TEXTS.keyStop]];
const KEYS: Keys = [
  [["C"], TEXTS.keySetup],
  [["L"], TEXTS.keyLive],
  [["Space"], TEXTS.keyHold],
  [["M"], TEXTS.keyCursors],
  [["Ctrl", "Wheel"], TEXTS.keyWheel],
  [["← →"], TEXTS.keyArrows],
  [["Enter"], TEXTS.keyEnter],
  [["G"], TEXTS.keyGlossary],
  [["D"], TEXTS.keyDocs],
  [["?"], TEXTS.keyList],
];

export function Shortcuts({ opened, onClose }: { opened: boolean; onClose: () => void }) {
  const { change } = usePreferences();
  const pages = usePages().map(({ key, name }): Keys[number] => [
    [key.toUpperCase()],
    fillText(TEXTS.keyPage, { page: name }),
  ]);
  return (
    <Modal opened={opened} onClose={onClose} title={TEXTS.shortcuts} size="lg">
      <Button
        variant="default"
        size="compact-sm"
        mb="sm"
        onClick={() => {
          change({ toured: false });
          onClose();
        }}
      >
        {TEXTS.showTour}
      </Button>
      <Button
        component={Link}
        href="/glossary"
        variant="default"
        size="compact-sm"
        mb="sm"
        ml="xs"
        onClick={onClose}
      >
        {TEXTS.glossary}
      </Button>
      <Button
        component={Link}
        href="/docs"
        variant="default"
        size="compact-sm"
        mb="sm"
        ml="xs"
        onClick={onClose}
      >
        {TEXTS.docs}
      </Button>
      <Table withRowBorders={false}>
        <Table.Tbody>
          {[...STOP, ...pages, ...KEYS].map(([keys, meaning]) => (
            <Table.Tr key={meaning}>
              <Table.Td w={180}>
                {keys.map((key, index) => (
                  <span key={key}>
                    {index > 0 && " + "}
                    <Kbd>{key}</Kbd>
                  </span>
                ))}
              </Table.Td>
              <Table.Td>{meaning}</Table.Td>
            </Table.Tr>
          ))}
        </Table.Tbody>
      </Table>
    </Modal>
  );
}

/** Explanation of an input on hover and focus; typing closes it. */

/** Handlers for the input itself, which remains in the tab order; empty without an entry. */
export function help(entry: Entry | undefined): Handlers {
  if (entry === undefined) return {};
  return {
    ...explaining([entry]),
    onInput: (event: FormEvent<HTMLElement>) => closeExplanation(event.currentTarget),
  };
}

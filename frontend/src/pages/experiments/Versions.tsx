/** Versions of an own experiment: who kept each and when, what differs from what stands here, and back to an older one. */

import { Button, Table } from "@mantine/core";
import { useQueries, useQuery } from "@tanstack/react-query";
import { dateTime } from "../../samples/format";
import { useAngles } from "../../service/angles";
import { experimentTextQuery, experimentVersionsQuery } from "../../service/ownExperiments";
import page from "../Page.module.css";
import { differences } from "./differences";
import { asDocument, type Document } from "./document";

interface VersionsProps {
  readonly name: string;
  readonly document: Document | null;
  /** Opens one; kept again it is the newest. */
  onOpen(name: string): void;
}

const MOST = 10;

export function Versions({ name, document, onOpen }: VersionsProps) {
  const angles = useAngles();
  const { data = [] } = useQuery(experimentVersionsQuery(name));
  const listed = data.slice(0, MOST);
  const texts = useQueries({
    queries: listed.map(({ version }) => experimentTextQuery(`${name}@${version}`)),
  });
  if (listed.length === 0) return null;
  return (
    <details>
      <summary>
        Versions of {name}: {data.length}
      </summary>
      <Table aria-label={`Versions of ${name}`} verticalSpacing={4}>
        <Table.Thead>
          <Table.Tr>
            <Table.Th>Version</Table.Th>
            <Table.Th>Kept</Table.Th>
            <Table.Th>To what stands here</Table.Th>
            <Table.Th aria-label="Open" />
          </Table.Tr>
        </Table.Thead>
        <Table.Tbody>
          {listed.map(({ version, who, created }, index) => {
            const then = asDocument(texts[index]?.data?.document);
            return (
              <Table.Tr key={version}>
                <Table.Td>{version}</Table.Td>
                <Table.Td>
                  {who}, {dateTime(created)}
                </Table.Td>
                <Table.Td>
                  {then === null || document === null ? (
                    <span className={page.dim}>not compared</span>
                  ) : (
                    differences(then, document, angles).join("; ") || "the same"
                  )}
                </Table.Td>
                <Table.Td>
                  <Button
                    size="compact-xs"
                    variant="default"
                    aria-label={`Open version ${version}`}
                    onClick={() => onOpen(`${name}@${version}`)}
                  >
                    Open
                  </Button>
                </Table.Td>
              </Table.Tr>
            );
          })}
        </Table.Tbody>
      </Table>
    </details>
  );
}

// A fleet control made of the npm package vda-5050-lib, which checks each message by the schemas of VDA 5050 2.0.
//
// Argument: a JSON object with `broker` (URL), `names` (the nodes of a way) and `edges` (one less).
// It orders carrier_01 to the second node, releases all of the way but the last edge when it is there, then sends it to the end and
// cancels that on the way. It prints what happens as lines of JSON, and ends with exit code 0 when the order is cancelled.
const { BlockingType, MasterController, Topic } = require("vda-5050-lib");

const { broker, names, edges } = JSON.parse(process.argv[2]);
const carrier = { manufacturer: "orchard", serialNumber: "carrier_01" };
const master = new MasterController(
  { interfaceName: "uagv", transport: { brokerUrl: broker }, vdaVersion: "2.0.0" },
  {},
);

const tell = (what) => console.log(JSON.stringify(what));

const order = (update, first, released) => ({
  orderId: "one",
  orderUpdateId: update,
  nodes: names
    .map((nodeId, n) => ({ nodeId, sequenceId: 2 * n, released: n <= released, actions: [] }))
    .slice(first),
  edges: edges
    .map((edgeId, n) => ({
      edgeId,
      sequenceId: 2 * n + 1,
      released: n < released,
      startNodeId: names[n],
      endNodeId: names[n + 1],
      actions: [],
    }))
    .slice(first),
});

const send = (update, first, released, then) =>
  master.assignOrder(carrier, order(update, first, released), {
    onNodeTraversed: (node) => tell({ traversed: node.nodeId, update }),
    onOrderProcessed: (error, byCancelation, active) => {
      tell({ processed: update, error: error ?? null, byCancelation, active: active ?? false });
      then();
    },
  });

const cancel = () => {
  const action = {
    actionId: "stop here",
    actionType: "cancelOrder",
    blockingType: BlockingType.Hard,
  };
  return master.initiateInstantActions(carrier, { instantActions: [action] }, {
    onActionStateChanged: (state) => tell({ action: state.actionId, is: state.actionStatus }),
    onActionError: (error) => tell({ error }),
  });
};

const end = async () => {
  await master.stop();
  process.exit(0);
};

const last = names.length - 1;
let isOrdered = false;

const begin = async () => {
  await master.start();
  await master.subscribe(Topic.Factsheet, carrier, (sheet) =>
    tell({ factsheet: sheet.typeSpecification.seriesName }),
  );
  await master.subscribe(Topic.State, carrier, async (state) => {
    if (!isOrdered && state.lastNodeId === names[0]) {
      isOrdered = true;
      await send(0, 0, 1, async () => {
        await send(1, 1, last - 1, async () => {
          await send(2, last - 1, last, end);
          await cancel();
        });
      });
    }
  });
};

begin().catch((error) => {
  console.error(error);
  process.exit(1);
});
